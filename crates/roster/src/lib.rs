//! The one crate that knows every core: from a name to a node.

use quantity::Time;
use service_core::{AnyCore, AnyNode, Core, Identity, Node, Start, Stepper};
use settings::{Arena, ConfigError};
use wire::Secret;

/// The services of an arena, bridges included, in the order they are started.
pub const SERVICES: &[&str] = &[
    vicon_bridge::ViconBridge::NAME,
    radio_bridge::RadioBridge::NAME,
    estimator::Estimator::NAME,
    hover_controller::HoverController::NAME,
    flip_manager::FlipManager::NAME,
    learner::Learner::NAME,
];

/// The node of a service.
///
/// # Errors
/// An unknown name, or a setting the service cannot work with.
pub fn node(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    let build = match name {
        vicon_bridge::ViconBridge::NAME => boxed_node::<vicon_bridge::ViconBridge>,
        radio_bridge::RadioBridge::NAME => boxed_node::<radio_bridge::RadioBridge>,
        estimator::Estimator::NAME => boxed_node::<estimator::Estimator>,
        hover_controller::HoverController::NAME => boxed_node::<hover_controller::HoverController>,
        flip_manager::FlipManager::NAME => boxed_node::<flip_manager::FlipManager>,
        learner::Learner::NAME => boxed_node::<learner::Learner>,
        _ => return Err(unknown(name)),
    };
    build(arena, secret, identity, now)
}

/// The core of a service without a bus: what a re-execution steps.
///
/// # Errors
/// An unknown name, or a setting the service cannot work with.
pub fn core(name: &str, arena: &Arena, start: Start) -> Result<Box<dyn AnyCore>, ConfigError> {
    let build = match name {
        vicon_bridge::ViconBridge::NAME => boxed_core::<vicon_bridge::ViconBridge>,
        radio_bridge::RadioBridge::NAME => boxed_core::<radio_bridge::RadioBridge>,
        estimator::Estimator::NAME => boxed_core::<estimator::Estimator>,
        hover_controller::HoverController::NAME => boxed_core::<hover_controller::HoverController>,
        flip_manager::FlipManager::NAME => boxed_core::<flip_manager::FlipManager>,
        learner::Learner::NAME => boxed_core::<learner::Learner>,
        _ => return Err(unknown(name)),
    };
    build(arena, start)
}

fn boxed_node<C: Core + 'static>(
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    Ok(Box::new(Node::<C>::new(arena, secret, identity, now)?))
}

fn boxed_core<C: Core + 'static>(arena: &Arena, start: Start) -> Result<Box<dyn AnyCore>, ConfigError> {
    Ok(Box::new(Stepper::<C>::new(arena, start)?))
}

fn unknown(name: &str) -> ConfigError {
    ConfigError::Malformed {
        file: "the roster".to_owned(),
        reason: format!("no service is called {name}; there are {}", SERVICES.join(", ")),
    }
}
