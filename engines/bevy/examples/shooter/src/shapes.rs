//! Shapes, colours and cameras of pictures. Nothing is lit: shades are painted onto the shapes, so
//! that pictures are quick to draw in software, too.

use crate::arena::{HALF_SIZE, NUM_SHOOTERS};
use crate::target;
use crate::view::BODY_HEIGHT;
use crate::{shooter, sight};
use bevy_asset::Assets;
use bevy_camera::{Camera, Camera3d, ClearColorConfig, PerspectiveProjection, Projection};
use bevy_color::Color;
use bevy_core_pipeline::tonemapping::Tonemapping;
use bevy_ecs::prelude::*;
use bevy_ludus::camera::LudusFilmCamera;
use bevy_math::Vec3;
use bevy_math::primitives::{Cuboid, Cylinder};
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues};
use bevy_pbr::{MeshMaterial3d, StandardMaterial};
use bevy_transform::components::Transform;

type Material = MeshMaterial3d<StandardMaterial>;

const SKY: Color = Color::srgb_u8(188, 214, 235);
/// Where the light seems to come from.
const SUN: Vec3 = Vec3::new(0.35, 0.8, 0.5);
/// Height of the eyes, and how far they are before the middle of the body, metres.
const EYE: Vec3 = Vec3::new(0.0, 1.1, -0.4);
/// Width of an eye's picture divided by its height.
pub const ASPECT: f32 = 4.0 / 3.0;
/// Height of the camera over the arena, metres, and its angle of view, radians.
const OVERVIEW_HEIGHT: f32 = 40.0;
const OVERVIEW_ANGLE: f32 = 0.53;

/// What all worlds share.
#[derive(Resource)]
pub struct Shapes {
    pub cube: Mesh3d,
    pub target: Mesh3d,
    pub body: Mesh3d,
    pub floor: Material,
    pub border: Material,
    pub wall: Material,
    pub red: Material,
    pub flash: Material,
    pub rifle: Material,
    pub shooters: [Material; NUM_SHOOTERS],
}

impl FromWorld for Shapes {
    fn from_world(world: &mut World) -> Self {
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let mut shape = |mesh: Mesh| Mesh3d(meshes.add(shaded(mesh)));
        let cube = shape(Cuboid::new(1.0, 1.0, 1.0).into());
        let target = shape(Cylinder::new(target::RADIUS, BODY_HEIGHT).into());
        let body = shape(Cylinder::new(shooter::RADIUS, BODY_HEIGHT).into());
        let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
        let mut paint = |red, green, blue| {
            MeshMaterial3d(materials.add(StandardMaterial {
                base_color: Color::srgb_u8(red, green, blue),
                unlit: true,
                ..StandardMaterial::default()
            }))
        };
        Self {
            cube,
            target,
            body,
            floor: paint(222, 214, 199),
            border: paint(120, 113, 108),
            wall: paint(168, 140, 110),
            red: paint(230, 40, 40),
            flash: paint(255, 190, 20),
            rifle: paint(45, 45, 50),
            shooters: [paint(37, 99, 235), paint(5, 150, 105), paint(147, 51, 234)],
        }
    }
}

/// Paints shades onto a shape, as if the sun shone on it.
fn shaded(mesh: Mesh) -> Mesh {
    let Some(VertexAttributeValues::Float32x3(normals)) = mesh.attribute(Mesh::ATTRIBUTE_NORMAL)
    else {
        return mesh;
    };
    let sun = SUN.normalize();
    let shade = |normal: &[f32; 3]| {
        let light = 0.55 + 0.45 * Vec3::from_array(*normal).dot(sun);
        [light, light, light, 1.0]
    };
    let shades: Vec<_> = normals.iter().map(shade).collect();
    mesh.with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, shades)
}

/// A camera in the eyes of a shooter, as wide as its rays.
pub fn eye_camera() -> impl Bundle {
    let half_width = (0.5 * sight::ANGLE_OF_VIEW).to_radians().tan();
    let angle = 2.0 * (half_width / ASPECT).atan();
    (camera(angle, 0), Transform::from_translation(EYE))
}

/// A camera for films high above the arena.
pub fn overview() -> impl Bundle {
    let film = LudusFilmCamera {
        width: 270,
        height: 270,
    };
    let above = Vec3::new(0.0, OVERVIEW_HEIGHT, 0.0);
    let place = Transform::from_translation(above).looking_at(Vec3::ZERO, Vec3::NEG_Z);
    debug_assert!(OVERVIEW_HEIGHT * (0.5 * OVERVIEW_ANGLE).tan() > HALF_SIZE);
    (film, camera(OVERVIEW_ANGLE, 1), place)
}

/// Makes a camera; in films, pictures stand from left to right by the order of their cameras.
fn camera(fov: f32, order: isize) -> impl Bundle {
    (
        Camera3d::default(),
        Camera {
            clear_color: ClearColorConfig::Custom(SKY),
            order,
            ..Camera::default()
        },
        Projection::Perspective(PerspectiveProjection {
            fov,
            near: 0.05,
            ..PerspectiveProjection::default()
        }),
        Tonemapping::None,
    )
}
