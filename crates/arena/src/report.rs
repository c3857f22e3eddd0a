//! What a learning experiment came to: the report that `arena learn` prints and writes.

use std::fmt::Write as _;

use quantity::Time;
use schemas::{FlipError, FlipOutcome, FlipParameters, ManeuverResult, PlantManeuver};
use serde::Serialize;

/// A whole experiment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LearnReport {
    /// The scenario's name.
    pub scenario: String,
    /// The seed of everything random.
    pub seed: u64,
    /// Digest of every datagram of the run: the same seed gives the same one on every machine.
    pub digest: String,
    /// Virtual time flown.
    pub virtual_s: f64,
    /// Time it took.
    pub wall_s: f64,
    /// Each vehicle's flips.
    pub vehicles: Vec<VehicleReport>,
}

/// One vehicle's flips.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleReport {
    /// The vehicle.
    pub id: u8,
    /// Its flips, in order.
    pub iterations: Vec<FlipReport>,
    /// Why its learning ended before all flips were flown; absent where it did not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
}

/// One flip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlipReport {
    /// Counted from zero.
    pub index: u32,
    /// How it went.
    pub outcome: Outcome,
    /// The parameters flown.
    pub parameters: Parameters,
    /// Final error as the flip manager measured it.
    pub error: Error,
    /// Final error as it truly was.
    pub true_error: Error,
    /// When it truly began, in virtual seconds.
    pub began_s: f64,
    /// Battery voltage at rest before it.
    pub battery_v: f64,
}

/// How a flip went.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// Flown and measured.
    Completed,
    /// Ended early.
    Aborted,
    /// Flown, not measured.
    Unmeasured,
}

/// The five parameters of the flip primitive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Parameters {
    /// Collective acceleration of the first step.
    pub u1_m_s2: f64,
    /// Duration of the first step.
    pub t1_s: f64,
    /// Duration of the coast.
    pub t3_s: f64,
    /// Collective acceleration of the last step.
    pub u5_m_s2: f64,
    /// Duration of the last step.
    pub t5_s: f64,
}

/// A final error in the plane of the flip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Error {
    /// Forward.
    pub x_m: f64,
    /// Up.
    pub z_m: f64,
    /// Forward speed.
    pub vx_m_s: f64,
    /// Upward speed.
    pub vz_m_s: f64,
    /// Pitch beyond whole turns.
    pub theta_rad: f64,
}

impl Error {
    /// In the order of the paper's equations: x, z, vx, vz, theta.
    #[must_use]
    pub fn to_array(self) -> [f64; 5] {
        [self.x_m, self.z_m, self.vx_m_s, self.vz_m_s, self.theta_rad]
    }

    /// The plain 2-norm over mixed units, which the paper's figures are judged by.
    #[must_use]
    pub fn norm(self) -> f64 {
        quantity::math::sqrt(self.to_array().iter().map(|component| component * component).sum())
    }
}

impl Parameters {
    /// In the paper's order: U1, T1, T3, U5, T5.
    #[must_use]
    pub fn to_array(self) -> [f64; 5] {
        [self.u1_m_s2, self.t1_s, self.t3_s, self.u5_m_s2, self.t5_s]
    }
}

impl From<FlipError> for Error {
    fn from(error: FlipError) -> Self {
        let FlipError { x_m, z_m, vx_m_s, vz_m_s, theta_rad } = error;
        Self { x_m, z_m, vx_m_s, vz_m_s, theta_rad }
    }
}

impl From<FlipParameters> for Parameters {
    fn from(parameters: FlipParameters) -> Self {
        let FlipParameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s } = parameters;
        Self { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s }
    }
}

impl FlipReport {
    /// A flip's report from what the flip manager measured and what the plant knows.
    #[must_use]
    pub fn new(result: &ManeuverResult, truth: Option<&PlantManeuver>, started: Time) -> Self {
        Self {
            index: result.iteration,
            outcome: match result.outcome {
                FlipOutcome::Completed => Outcome::Completed,
                FlipOutcome::Aborted => Outcome::Aborted,
                FlipOutcome::Unmeasured => Outcome::Unmeasured,
            },
            parameters: result.parameters.into(),
            error: result.error.into(),
            true_error: truth.map(|truth| truth.error.into()).unwrap_or_default(),
            began_s: (truth.map_or(result.began_at, |truth| truth.began_at) - started).as_secs_f64(),
            battery_v: result.battery_v,
        }
    }

    /// One line for a terminal.
    #[must_use]
    pub fn line(&self, vehicle: u8) -> String {
        let mut line =
            format!("vehicle {vehicle}  flip {:3}  {:<10}", self.index, format!("{:?}", self.outcome));
        let p = self.parameters;
        let _ = write!(
            line,
            "  U1 {:6.3} T1 {:.4} T3 {:.4} U5 {:6.3} T5 {:.4}",
            p.u1_m_s2, p.t1_s, p.t3_s, p.u5_m_s2, p.t5_s
        );
        for (name, error) in [("measured", self.error), ("true", self.true_error)] {
            let _ = write!(
                line,
                "  {name} x {:+.3} z {:+.3} vx {:+.3} vz {:+.3} theta {:+.3}",
                error.x_m, error.z_m, error.vx_m_s, error.vz_m_s, error.theta_rad
            );
        }
        line
    }
}

impl LearnReport {
    /// One row per flip, a header first.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut csv = String::from(
            "vehicle,index,outcome,began_s,battery_v,u1_m_s2,t1_s,t3_s,u5_m_s2,t5_s,\
             x_m,z_m,vx_m_s,vz_m_s,theta_rad,true_x_m,true_z_m,true_vx_m_s,true_vz_m_s,true_theta_rad\n",
        );
        for vehicle in &self.vehicles {
            for flip in &vehicle.iterations {
                let outcome = match flip.outcome {
                    Outcome::Completed => "completed",
                    Outcome::Aborted => "aborted",
                    Outcome::Unmeasured => "unmeasured",
                };
                let _ = write!(
                    csv,
                    "{},{},{outcome},{},{}",
                    vehicle.id, flip.index, flip.began_s, flip.battery_v
                );
                for value in flip
                    .parameters
                    .to_array()
                    .into_iter()
                    .chain(flip.error.to_array())
                    .chain(flip.true_error.to_array())
                {
                    let _ = write!(csv, ",{value}");
                }
                csv.push('\n');
            }
        }
        csv
    }
}
