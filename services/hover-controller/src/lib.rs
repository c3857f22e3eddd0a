//! Take-off, hover, recovery and landing.
