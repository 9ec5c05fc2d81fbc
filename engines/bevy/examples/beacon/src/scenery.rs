//! How the world scenery. All colours are as they are said to be: nothing is lit or shaded.

use crate::{Beacon, NUM_WATCHERS, Watcher};
use bevy_asset::{Assets, Handle};
use bevy_camera::{Camera, Camera3d, ClearColorConfig, PerspectiveProjection, Projection};
use bevy_color::Color;
use bevy_core_pipeline::tonemapping::Tonemapping;
use bevy_ecs::prelude::*;
use bevy_ludus::camera::{LudusCamera, LudusFilmCamera};
use bevy_ludus::prelude::*;
use bevy_math::Vec3;
use bevy_math::primitives::{Cone, Cuboid};
use bevy_mesh::{Mesh, Mesh3d};
use bevy_pbr::{MeshMaterial3d, StandardMaterial};
use bevy_transform::components::Transform;
use std::f32::consts::FRAC_PI_2;

/// How far the beacon stands from the middle, metres.
const BEACON_DISTANCE: f32 = 4.0;
const BEACON_WIDTH: f32 = 1.0;
const BEACON_HEIGHT: f32 = 2.0;
const SKY: Color = Color::srgb_u8(20, 40, 60);
/// From where the world is filmed, metres above the ground.
const FILM_HEIGHT: f32 = 15.0;

/// Shapes that all worlds share.
#[derive(Resource)]
pub struct Scenery {
    beacon: Handle<Mesh>,
    pointer: Handle<Mesh>,
    pointer_material: Handle<StandardMaterial>,
}

impl FromWorld for Scenery {
    fn from_world(world: &mut World) -> Self {
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let beacon = meshes.add(Cuboid::new(BEACON_WIDTH, BEACON_HEIGHT, BEACON_WIDTH));
        let pointer = meshes.add(Cone::new(0.3, 1.2));
        let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
        Self {
            beacon,
            pointer,
            pointer_material: materials.add(plain(Color::WHITE)),
        }
    }
}

fn plain(base_color: Color) -> StandardMaterial {
    StandardMaterial {
        base_color,
        unlit: true,
        ..StandardMaterial::default()
    }
}

/// Puts watchers with their cameras, a beacon, and a camera for films into each world.
pub fn fill_world(
    add: On<Add, LudusWorld>,
    mut commands: Commands,
    scenery: Res<Scenery>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let home = InWorld(add.entity);
    commands.spawn((
        Beacon::default(),
        home,
        Mesh3d(scenery.beacon.clone()),
        MeshMaterial3d(materials.add(plain(Color::WHITE))),
    ));
    for _ in 0..NUM_WATCHERS {
        let watcher = (
            Agent::of("watcher"),
            home,
            Watcher::default(),
            Transform::default(),
        );
        let watcher = commands
            .spawn((watcher, bevy_camera::visibility::Visibility::default()))
            .id();
        commands.spawn((eye(watcher), ChildOf(watcher)));
        // Only films show which way a watcher looks; its own eye is in front of it.
        let pointer = Transform::from_xyz(0.0, -1.5, -0.6)
            .with_rotation(bevy_math::Quat::from_rotation_x(-FRAC_PI_2));
        let material = MeshMaterial3d(scenery.pointer_material.clone());
        commands.spawn((
            ChildOf(watcher),
            Mesh3d(scenery.pointer.clone()),
            material,
            pointer,
        ));
    }
    commands.spawn((film_camera(), home));
}

fn eye(watcher: Entity) -> impl Bundle {
    (
        LudusCamera::of(watcher, "eye"),
        Camera3d::default(),
        Camera {
            clear_color: ClearColorConfig::Custom(SKY),
            ..Camera::default()
        },
        Projection::Perspective(PerspectiveProjection {
            fov: 1.0,
            ..PerspectiveProjection::default()
        }),
        Tonemapping::None,
    )
}

fn film_camera() -> impl Bundle {
    (
        LudusFilmCamera {
            width: 320,
            height: 320,
        },
        Camera3d::default(),
        Tonemapping::None,
        Transform::from_xyz(0.0, FILM_HEIGHT, 0.0).looking_at(Vec3::ZERO, Vec3::NEG_Z),
    )
}

type BeaconLook<'a> = (
    &'a Beacon,
    &'a mut Transform,
    &'a MeshMaterial3d<StandardMaterial>,
);

/// Moves what is seen to where the game says that it is.
pub fn show(
    mut watchers: Query<(&Watcher, &mut Transform)>,
    mut beacons: Query<BeaconLook<'_>, (Changed<Beacon>, Without<Watcher>)>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (watcher, mut transform) in &mut watchers {
        *transform = Transform::from_rotation(bevy_math::Quat::from_rotation_y(watcher.heading));
    }
    for (beacon, mut transform, material) in &mut beacons {
        let turned = Transform::from_rotation(bevy_math::Quat::from_rotation_y(beacon.direction));
        *transform = turned.with_translation(turned.forward() * BEACON_DISTANCE);
        if let Some(mut material) = materials.get_mut(&material.0) {
            let [red, green, blue] = beacon.colour;
            material.base_color = Color::srgb_u8(red, green, blue);
        }
    }
}
