//! Learns a flip from how the last one ended.
