//! The arena as a whole, one module per subject.
