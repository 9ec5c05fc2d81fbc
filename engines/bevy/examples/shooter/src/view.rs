//! How the arena looks: simple shapes, cameras for films, and the eyes of shooters.
//!
//! In pictures the arena lies flat: its x is Bevy's x, its y is Bevy's −z, and y is up.

use crate::Number;
use crate::arena::{Arena, HALF_SIZE, MAX_WALLS, NUM_SHOOTERS, NUM_STANDS};
use crate::shapes::{Shapes, eye_camera, overview};
use crate::shooter::Shooter;
use bevy_app::prelude::*;
use bevy_camera::visibility::Visibility;
use bevy_ecs::prelude::*;
use bevy_light::LightPlugin;
use bevy_ludus::camera::{LudusFilmCamera, RenderingPlugins};
use bevy_ludus::prelude::*;
use bevy_math::{Quat, Vec2, Vec3};
use bevy_mesh::Mesh3d;
use bevy_pbr::{MeshMaterial3d, PbrPlugin};
use bevy_transform::components::Transform;
use std::f32::consts::FRAC_PI_2;

/// Height of walls and of a shooter's body, metres.
pub const WALL_HEIGHT: f32 = 1.6;
pub const BODY_HEIGHT: f32 = 1.0;
/// Of a shot's trace.
const SHOT_HEIGHT: f32 = 0.8;
const SHOT_WIDTH: f32 = 0.08;
/// Where it begins, before the middle of the body, metres.
const MUZZLE: f32 = 1.0;

/// Draws the arena.
pub struct ViewPlugin;

impl Plugin for ViewPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins((RenderingPlugins, LightPlugin, PbrPlugin::default()))
            .init_resource::<Shapes>()
            .add_observer(furnish)
            .add_observer(dress)
            .add_systems(Observe, (show_shooters, show_parts));
    }
}

/// A part of the arena that comes and goes, with its number.
#[derive(Component, Clone, Copy, Debug)]
enum Part {
    Wall(usize),
    Target(usize),
    Shot(usize),
}

/// Puts the floor, the border, all that comes and goes, and the overview into a world.
fn furnish(add: On<Add, LudusWorld>, shapes: Res<Shapes>, mut commands: Commands) {
    let home = InWorld(add.entity);
    let mut put = |mesh: &Mesh3d, material: &_, transform: Transform| {
        let material: &MeshMaterial3d<_> = material;
        commands
            .spawn((home, mesh.clone(), material.clone(), transform))
            .id()
    };
    put(
        &shapes.cube,
        &shapes.floor,
        slab(Vec2::ZERO, Vec2::splat(HALF_SIZE), -0.1, 0.0),
    );
    for side in [Vec2::X, Vec2::Y, Vec2::NEG_X, Vec2::NEG_Y] {
        let half = side.abs() * 0.15 + side.perp().abs() * (HALF_SIZE + 0.3);
        put(
            &shapes.cube,
            &shapes.border,
            slab(side * (HALF_SIZE + 0.15), half, 0.0, WALL_HEIGHT),
        );
    }
    let mut parts = Vec::new();
    for number in 0..MAX_WALLS {
        parts.push((
            put(&shapes.cube, &shapes.wall, Transform::default()),
            Part::Wall(number),
        ));
    }
    for number in 0..NUM_STANDS {
        parts.push((
            put(&shapes.target, &shapes.red, Transform::default()),
            Part::Target(number),
        ));
    }
    for number in 0..NUM_SHOOTERS {
        parts.push((
            put(&shapes.cube, &shapes.flash, Transform::default()),
            Part::Shot(number),
        ));
    }
    for (entity, part) in parts {
        commands.entity(entity).insert((part, Visibility::Hidden));
    }
    commands.spawn((overview(), home));
}

/// Gives a shooter a body and a rifle, and eyes where somebody looks through them.
fn dress(
    add: On<Add, Number>,
    numbers: Query<&Number>,
    shapes: Res<Shapes>,
    mut commands: Commands,
) {
    let agent = add.entity;
    let Ok(Number(number)) = numbers.get(agent) else {
        return;
    };
    let colour = shapes.shooters[*number].clone();
    commands
        .entity(agent)
        .insert((Transform::default(), Visibility::Inherited));
    let body = Transform::from_xyz(0.0, 0.5 * BODY_HEIGHT, 0.0);
    commands.spawn((ChildOf(agent), shapes.body.clone(), colour, body));
    let rifle = Transform::from_xyz(0.2, 0.8, -0.6).with_scale(Vec3::new(0.06, 0.06, 0.7));
    commands.spawn((
        ChildOf(agent),
        shapes.cube.clone(),
        shapes.rifle.clone(),
        rifle,
    ));
    if *number == 0 {
        let film = LudusFilmCamera {
            width: 360,
            height: 270,
        };
        commands.spawn((ChildOf(agent), film, eye_camera()));
    }
    #[cfg(feature = "pixels")]
    commands.spawn((ChildOf(agent), crate::pixels::eye(agent), eye_camera()));
}

/// Moves the shooters of pictures to where those of the game are.
fn show_shooters(arenas: Query<&Arena>, mut shooters: Query<(&Number, &InWorld, &mut Transform)>) {
    for (number, home, mut transform) in &mut shooters {
        if let Ok(arena) = arenas.get(home.0) {
            let Shooter { place, heading, .. } = arena.shooters[number.0];
            *transform = Transform::from_translation(at(place, 0.0))
                .with_rotation(Quat::from_rotation_y(heading - FRAC_PI_2));
        }
    }
}

/// Shows walls, targets and shots where they are, and hides those that are not there.
fn show_parts(
    arenas: Query<&Arena>,
    mut parts: Query<(&Part, &InWorld, &mut Transform, &mut Visibility)>,
) {
    for (part, home, mut transform, mut visibility) in &mut parts {
        let found = arenas
            .get(home.0)
            .ok()
            .and_then(|arena| place(*part, arena));
        *visibility = match found {
            Some(_) => Visibility::Visible,
            None => Visibility::Hidden,
        };
        *transform = found.unwrap_or(*transform);
    }
}

/// Returns where a part is, if it is there.
fn place(part: Part, arena: &Arena) -> Option<Transform> {
    match part {
        Part::Wall(number) => arena.walls.get(number).map(|wall| {
            let half = 0.5 * (wall.max - wall.min);
            slab(wall.min + half, half, 0.0, WALL_HEIGHT)
        }),
        Part::Target(number) => {
            let target = &arena.targets[number];
            target
                .is_up
                .then(|| Transform::from_translation(at(target.place, 0.5 * BODY_HEIGHT)))
        }
        Part::Shot(number) => arena.shooters[number]
            .shot
            .map(|[from, to]| trace(from, to)),
    }
}

/// Stretches the unit cube to a box over a rectangle of the arena.
fn slab(middle: Vec2, half_size: Vec2, low: f32, high: f32) -> Transform {
    let size = Vec3::new(2.0 * half_size.x, high - low, 2.0 * half_size.y);
    Transform::from_translation(at(middle, 0.5 * (low + high))).with_scale(size)
}

/// Stretches the unit cube to the trace of a shot.
fn trace(from: Vec2, to: Vec2) -> Transform {
    let from = from.move_towards(to, MUZZLE);
    let length = from.distance(to).max(SHOT_WIDTH);
    Transform::from_translation(at(0.5 * (from + to), SHOT_HEIGHT))
        .with_rotation(Quat::from_rotation_y((to - from).to_angle()))
        .with_scale(Vec3::new(length, SHOT_WIDTH, SHOT_WIDTH))
}

/// Returns the point of pictures over a point of the arena.
fn at(place: Vec2, height: f32) -> Vec3 {
    Vec3::new(place.x, height, -place.y)
}
