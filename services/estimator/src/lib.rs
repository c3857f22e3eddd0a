//! Where each vehicle is, and where it will be when a command takes effect.
