//! Shooters that see pictures in the place of rays.

use bevy_ecs::entity::Entity;
use bevy_ludus::camera::{LudusCamera, Picture};
use bevy_ludus::prelude::*;

/// Name of the pictures' entry.
const EYE: &str = "eye";

/// What a shooter knows besides its picture.
#[derive(ObservationSpace, Clone, Copy, Debug, PartialEq)]
pub struct Pixels {
    /// How far the rifle is reloaded; it shoots at 1.
    #[ludus(low = 0.0, high = 1.0)]
    pub loaded: f32,
}

/// Adds the pictures to the observation of a policy.
pub fn with_eyes(policy: Policy) -> Policy {
    policy.camera(EYE, Picture::rgb(64, 48))
}

/// Makes a camera the eye of a shooter.
pub fn eye(agent: Entity) -> LudusCamera {
    LudusCamera::of(agent, EYE)
}
