//! One fear each. Every flight here also asserts, every 5 ms, that no vehicle leaves the hall.

/// The cameras lose a vehicle, or lie about it.
mod cameras;
/// A Crazyflie's radio, its bridge, its stop.
mod crazyflie;
/// The command link falls silent, in every phase of a flight.
mod link;
/// The bus loses, doubles, delays and bends datagrams.
mod network;
/// A service dies, sleeps or comes back.
mod services;
/// A person presses the emergency stop.
mod stop;
/// Sets for the vehicle on a link that loses, bends, doubles and shuffles.
mod uploads;
