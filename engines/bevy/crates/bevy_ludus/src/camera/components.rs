//! What makes a camera an agent's.

use bevy_ecs::prelude::*;
use bevy_render::view::Msaa;
use std::borrow::Cow;

/// The eye of an agent: put it on an entity that is a camera (`Camera3d`, `Camera2d`), and what the
/// camera sees becomes an entry of the agent's observation.
///
/// The entry is declared with [`Policy::camera`](crate::policy::Policy::camera). Every agent of the
/// policy needs its own camera, in its own world (by `InWorld`, or as a child of something that
/// is). It draws into an image of its own; leave its `RenderTarget` and its `is_active` alone.
/// There is no anti-aliasing, unless the entity is spawned with another `Msaa`.
///
/// ```
/// # use bevy_camera::Camera3d;
/// # use bevy_ecs::prelude::*;
/// # use bevy_ludus::camera::LudusCamera;
/// # use bevy_ludus::prelude::*;
/// fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
///     let hero = commands.spawn((Agent::of("hero"), InWorld(add.entity))).id();
///     commands.spawn((LudusCamera::of(hero, "eye"), Camera3d::default(), InWorld(add.entity)));
/// }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Eq)]
#[require(Msaa = Msaa::Off)]
pub struct LudusCamera {
    /// Whose eye it is.
    pub agent: Entity,
    /// Name of the entry.
    pub entry: Cow<'static, str>,
}

impl LudusCamera {
    /// Makes the eye of an agent that fills an entry.
    #[must_use]
    pub fn of(agent: Entity, entry: impl Into<Cow<'static, str>>) -> Self {
        Self {
            agent,
            entry: entry.into(),
        }
    }
}

/// A camera that takes pictures of a world for films: the trainer's call of the method
/// `picture` returns what it sees. It draws only then.
///
/// Put it on an entity that is a camera, in the world that it shows. `ludus record` makes films of
/// its pictures.
#[derive(Component, Clone, Debug, PartialEq, Eq)]
pub struct LudusFilmCamera {
    /// Width of its pictures, pixels.
    pub width: u32,
    /// Height of its pictures, pixels.
    pub height: u32,
}

impl Default for LudusFilmCamera {
    fn default() -> Self {
        Self {
            width: 640,
            height: 360,
        }
    }
}
