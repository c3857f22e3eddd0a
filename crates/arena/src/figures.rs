//! Which pictures an experiment gets, and what goes into them.

use maneuver::{Discretisation, Envelope, FlipDesign, Integral, Model};
use settings::{Arena, FleetVehicle};

use crate::pictures::{
    PictureError, SidePoint, SideView, errors_over_flips, parameters_over_flips, side_views,
};
use crate::report::LearnReport;

/// Step of the side views, as in the paper's Fig. 2.
const STEP_S: f64 = 0.005;

/// Every picture of an experiment as a file stem and an SVG drawing.
///
/// # Errors
/// The drawing library refuses.
pub fn all(
    arena: &Arena,
    report: &LearnReport,
    flown: &[(u8, Vec<SideView>)],
) -> Result<Vec<(String, String)>, PictureError> {
    let mut drawings = Vec::new();
    for vehicle in &report.vehicles {
        let Some(member) = arena.vehicle(vehicle.id) else { continue };
        let about = format!("{}, vehicle {}, seed {}", report.scenario, vehicle.id, report.seed);
        let title = format!("Final error over flips (lines measured, dots true): {about}");
        drawings.push((format!("errors-vehicle-{}", vehicle.id), errors_over_flips(&title, vehicle)?));
        let title = format!("Parameters over flips: {about}");
        drawings
            .push((format!("parameters-vehicle-{}", vehicle.id), parameters_over_flips(&title, vehicle)?));
        let mut views: Vec<SideView> = model_view(arena, member).into_iter().collect();
        views.extend(flown.iter().filter(|(id, _)| *id == vehicle.id).flat_map(|(_, views)| views.clone()));
        let title = format!("Side view in 5 ms steps: {about}");
        let drawing = side_views(&title, member.vehicle.airframe.arm_m, &views)?;
        drawings.push((format!("side-view-vehicle-{}", vehicle.id), drawing));
    }
    Ok(drawings)
}

/// The planar model a vehicle's learner uses, from its believed airframe.
#[must_use]
pub fn planar_model(member: &FleetVehicle) -> Model {
    let vehicle = &member.vehicle;
    Model {
        mass_kg: vehicle.airframe.mass_kg,
        arm_m: vehicle.airframe.arm_m,
        inertia_kg_m2: vehicle.airframe.inertia_kg_m2[1],
        rotor_gain_up_1_s: vehicle.rotor.gain_up_1_s,
        rotor_gain_down_1_s: vehicle.rotor.gain_down_1_s,
        thrust_n_min: vehicle.rotor.thrust_n_min,
        thrust_n_max: vehicle.rotor.thrust_n_max,
        rate_gain_p_1_s: vehicle.rate_loop.maneuver_p_1_s,
        rate_gain_i_1_s2: vehicle.rate_loop.maneuver_i_1_s2,
        integral: match vehicle.rate_loop.integral {
            settings::Integral::Literal => Integral::Literal,
            settings::Integral::Conditional => Integral::Conditional,
        },
    }
}

/// The model's own flip with its own P0; nothing where the design has none.
fn model_view(arena: &Arena, member: &FleetVehicle) -> Option<SideView> {
    let flip = arena.scenario.flip.as_ref()?;
    let model = planar_model(member);
    let design = FlipDesign {
        flips: flip.flips,
        rate_rad_s_max: flip.design_rate_rad_s,
        envelope: Envelope::with_margin(&model, flip.envelope_margin_ratio).ok()?,
    };
    let solution = maneuver::solve(&model, &design, Discretisation::Continuous).ok()?;
    let mut points: Vec<SidePoint> = Vec::new();
    maneuver::trajectory(&model, &design, &solution.parameters, Discretisation::Continuous, |t_s, state| {
        if t_s >= points.len() as f64 * STEP_S {
            points.push(SidePoint { t_s, x_m: state.x_m, z_m: state.z_m, theta_rad: state.theta_rad });
        }
    })
    .ok()?;
    Some(SideView { label: "a) the model with P0".to_owned(), points })
}
