//! What the hover controller is asked for in each phase.

use quantity::{Vector, World};
use schemas::{FlipPhase, GoalKind, VehicleGoal};
use settings::FleetVehicle;

/// A vehicle's fixed points in the hall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goals {
    vehicle: u8,
    /// Where it takes off and lands.
    ground_m: Vector<World>,
    /// Where its flips begin.
    pub(crate) place_m: Vector<World>,
    /// Plane of its flips.
    pub(crate) heading_rad: f64,
}

impl Goals {
    pub(crate) fn new(member: &FleetVehicle) -> Self {
        let part = &member.part;
        Self {
            vehicle: member.vehicle.id,
            ground_m: Vector::new(part.start_x_m, part.start_y_m, 0.0),
            place_m: Vector::new(part.place_x_m, part.place_y_m, part.place_z_m),
            heading_rad: part.heading_rad,
        }
    }

    /// The goal of that phase. Through a flip it stays the place: the vehicle ignores commands, and is caught
    /// there.
    pub(crate) fn of(&self, phase: FlipPhase) -> VehicleGoal {
        let (kind, position_m) = match phase {
            FlipPhase::Idle | FlipPhase::Done => (GoalKind::Ground, self.ground_m),
            FlipPhase::Landing => (GoalKind::Land, self.ground_m),
            FlipPhase::Approach
            | FlipPhase::Gate
            | FlipPhase::Upload
            | FlipPhase::Start
            | FlipPhase::Flip
            | FlipPhase::Measure
            | FlipPhase::Recover => (GoalKind::Hover, self.place_m),
        };
        VehicleGoal {
            vehicle: self.vehicle,
            kind,
            position_m,
            velocity_m_s: Vector::ZERO,
            acceleration_m_s2: Vector::ZERO,
            heading_rad: self.heading_rad,
        }
    }
}
