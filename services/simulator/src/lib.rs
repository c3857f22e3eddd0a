//! The plant in real time, speaking device bytes.
