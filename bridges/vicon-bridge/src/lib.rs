//! Motion-capture bytes in, frames of poses out.
