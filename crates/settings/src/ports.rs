//! Numbers of the bridges' device endpoints in `DeviceBytes`.

/// The device endpoints of the two bridges.
pub struct Ports;

impl Ports {
    /// The motion-capture system, at the vicon bridge: where it is asked, and where its frames come from unless
    /// it streams to a group.
    pub const MOTION_CAPTURE: u16 = 0x200;
    /// The group it streams to, where it does.
    pub const MOTION_CAPTURE_GROUP: u16 = 0x201;
    /// The data-link radio, at the radio bridge.
    pub const DATA_LINK: u16 = 0;

    /// The command-link encoder of a vehicle, or the vehicle where it is a Crazyflie, at the radio bridge.
    #[must_use]
    pub const fn command_link(vehicle: u8) -> u16 {
        0x100 | vehicle as u16
    }

    /// The vehicle whose command-link encoder that endpoint is.
    #[must_use]
    pub const fn vehicle_of_command_link(port: u16) -> Option<u8> {
        if port & 0xff00 == 0x100 { Some(port as u8) } else { None }
    }
}
