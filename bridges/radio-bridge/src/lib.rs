//! Commands and parameters in, radio bytes out; telemetry back.
