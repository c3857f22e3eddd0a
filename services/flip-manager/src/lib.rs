//! Gates, uploads, starts, watches and measures flips.
mod end_state;
mod gate;
mod goals;
mod poses;
mod tuning;
mod upload;
