//! What gives a core its clock, its sockets and its devices.
