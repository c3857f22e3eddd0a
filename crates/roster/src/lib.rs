//! The one crate that knows every core: from a name to a node.

use quantity::Time;
use service_core::{AnyNode, Core, Identity, Node};
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
    fn boxed<C: Core + 'static>(
        arena: &Arena,
        secret: &Secret,
        identity: Identity,
        now: Time,
    ) -> Result<Box<dyn AnyNode>, ConfigError> {
        Ok(Box::new(Node::<C>::new(arena, secret, identity, now)?))
    }
    let build = match name {
        vicon_bridge::ViconBridge::NAME => boxed::<vicon_bridge::ViconBridge>,
        radio_bridge::RadioBridge::NAME => boxed::<radio_bridge::RadioBridge>,
        estimator::Estimator::NAME => boxed::<estimator::Estimator>,
        hover_controller::HoverController::NAME => boxed::<hover_controller::HoverController>,
        flip_manager::FlipManager::NAME => boxed::<flip_manager::FlipManager>,
        learner::Learner::NAME => boxed::<learner::Learner>,
        _ => {
            return Err(ConfigError::Malformed {
                file: "the roster".to_owned(),
                reason: format!("no service is called {name}; there are {}", SERVICES.join(", ")),
            });
        }
    };
    build(arena, secret, identity, now)
}
