//! Rays: what a shooter sees of walls, targets and the others, and what a shot hits.

use crate::Number;
use crate::arena::{Arena, HALF_SIZE};
use crate::shooter::Shooter;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_math::bounding::{BoundingCircle, BoundingCircleCast, RayCast2d};
use bevy_math::{Dir2, Rot2, Vec2};

/// Rays of a shooter; the middle one points where it looks.
pub const NUM_RAYS: usize = 21;
/// Between two rays, degrees.
const RAY_STEP: f32 = 4.0;
/// From the leftmost ray to the rightmost, degrees.
pub const ANGLE_OF_VIEW: f32 = (NUM_RAYS - 1) as f32 * RAY_STEP;
/// Half the width of a ray, as far as targets and others are concerned, and of a shot, metres.
/// No target fits between two rays up to 12.8 m: each covers 0.9 m, as wide as they are apart there.
const BEAM_RADIUS: f32 = 0.1;
/// How far rays and shots reach, metres: across the arena.
const REACH: f32 = 2.0 * HALF_SIZE * std::f32::consts::SQRT_2;
/// Steps from one shot to the next.
pub const RELOAD_STEPS: u32 = 8;

/// What a shooter sees: along each ray, from left to right, how far it is to the first wall, target
/// and other shooter, as shares of the rays' reach; 1 where there is none before the wall.
#[cfg_attr(feature = "pixels", allow(dead_code))] // Pictures take its place.
#[derive(ObservationSpace, Clone, Copy, Debug, PartialEq)]
pub struct View {
    #[ludus(low = 0.0, high = 1.0)]
    pub walls: [f32; NUM_RAYS],
    #[ludus(low = 0.0, high = 1.0)]
    pub targets: [f32; NUM_RAYS],
    #[ludus(low = 0.0, high = 1.0)]
    pub others: [f32; NUM_RAYS],
    /// How far the rifle is reloaded; it shoots at 1.
    #[ludus(low = 0.0, high = 1.0)]
    pub loaded: f32,
}

/// What is at the end of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hit {
    Wall,
    /// With its number.
    Target(usize),
    Other,
}

/// Distances along one ray, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Distances {
    wall: f32,
    /// Of the nearest target before the wall, and its number.
    target: Option<(f32, usize)>,
    other: Option<f32>,
}

/// The eyes of a shooter: they measure along all rays.
#[derive(Component, Clone, Copy, Debug)]
pub struct Eyes;

impl Sensor for Eyes {
    type Value = Rays;
    type Param = (
        Query<'static, 'static, &'static Number>,
        Query<'static, 'static, &'static Arena>,
    );

    fn sense(
        &self,
        agent: Entity,
        home: InWorld,
        (numbers, arenas): &(Query<&Number>, Query<&Arena>),
    ) -> Rays {
        match (numbers.get(agent), arenas.get(home.0)) {
            (Ok(number), Ok(arena)) => Rays::look(arena, number.0),
            _ => Rays::CLEAR,
        }
    }
}

/// Distances along the rays from left to right, as in [`View`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    walls: [f32; NUM_RAYS],
    targets: [f32; NUM_RAYS],
    others: [f32; NUM_RAYS],
}

impl Rays {
    const CLEAR: Self = Self {
        walls: [1.0; NUM_RAYS],
        targets: [1.0; NUM_RAYS],
        others: [1.0; NUM_RAYS],
    };

    /// Looks through the eyes of the shooter of a number.
    fn look(arena: &Arena, number: usize) -> Self {
        let shooter = &arena.shooters[number];
        let mut rays = Self::CLEAR;
        let step = Rot2::degrees(-RAY_STEP);
        let mut rotation = shooter.rotation() * Rot2::degrees(0.5 * ANGLE_OF_VIEW);
        for ray in 0..NUM_RAYS {
            let found = measure(arena, number, direction(rotation));
            rays.walls[ray] = found.wall / REACH;
            rays.targets[ray] = found.target.map_or(1.0, |(distance, _)| distance / REACH);
            rays.others[ray] = found.other.map_or(1.0, |distance| distance / REACH);
            rotation = (rotation * step).fast_renormalize();
        }
        rays
    }
}

impl View {
    /// Takes what the eyes have measured.
    #[cfg_attr(feature = "pixels", allow(dead_code))]
    pub fn take_rays(&mut self, rays: Rays) {
        self.walls = rays.walls;
        self.targets = rays.targets;
        self.others = rays.others;
    }
}

/// Returns how far the rifle is reloaded, from 0 to 1.
pub fn loaded(shooter: &Shooter) -> f32 {
    1.0 - shooter.steps_to_reload as f32 / RELOAD_STEPS as f32
}

/// Returns what a shot of a shooter hits, and where it ends: at what the middle ray sees first.
pub fn aim(arena: &Arena, number: usize) -> (Hit, Vec2) {
    let shooter = &arena.shooters[number];
    let direction = direction(shooter.rotation());
    let found = measure(arena, number, direction);
    let (hit, distance) = match (found.target, found.other) {
        (Some((distance, _)), Some(other)) if other < distance => (Hit::Other, other),
        (Some((distance, target)), _) => (Hit::Target(target), distance),
        (None, Some(other)) => (Hit::Other, other),
        (None, None) => (Hit::Wall, found.wall),
    };
    (hit, shooter.place + direction * distance)
}

fn direction(rotation: Rot2) -> Dir2 {
    Dir2::new_unchecked(Vec2::new(rotation.cos, rotation.sin))
}

fn measure(arena: &Arena, number: usize, direction: Dir2) -> Distances {
    let origin = arena.shooters[number].place;
    let wall = distance_to_wall(arena, origin, direction);
    let beam = Beam::new(origin, direction, wall);
    let targets = arena.targets.iter().enumerate();
    let target = targets
        .filter(|(_, target)| target.is_up)
        .filter_map(|(index, target)| Some((beam.distance(target.circle())?, index)))
        .min_by(|one, other| one.0.total_cmp(&other.0));
    let others = arena.shooters.iter().enumerate();
    let other = others
        .filter(|(index, _)| *index != number)
        .filter_map(|(_, other)| beam.distance(other.circle()))
        .min_by(f32::total_cmp);
    Distances {
        wall,
        target,
        other,
    }
}

/// Returns the distance to the first wall, or to the border of the arena.
fn distance_to_wall(arena: &Arena, origin: Vec2, direction: Dir2) -> f32 {
    let ray = RayCast2d::new(origin, direction, REACH);
    let walls = arena.walls.iter();
    walls
        .filter_map(|wall| ray.aabb_intersection_at(wall))
        .fold(distance_to_border(origin, direction), f32::min)
}

fn distance_to_border(origin: Vec2, direction: Dir2) -> f32 {
    let along = |place: f32, speed: f32| (HALF_SIZE - place * speed.signum()) / speed.abs();
    along(origin.x, direction.x).min(along(origin.y, direction.y))
}

/// A ray of some width that ends at a wall.
struct Beam(BoundingCircleCast);

impl Beam {
    fn new(origin: Vec2, direction: Dir2, length: f32) -> Self {
        let front = BoundingCircle::new(Vec2::ZERO, BEAM_RADIUS);
        Self(BoundingCircleCast::new(front, origin, direction, length))
    }

    fn distance(&self, circle: BoundingCircle) -> Option<f32> {
        self.0.circle_collision_at(circle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooter;
    use crate::target::{self, Target};
    use bevy_math::bounding::Aabb2d;
    use proptest::prelude::*;
    use std::f32::consts::PI;

    const MIDDLE: usize = NUM_RAYS / 2;

    /// The first shooter stands in the middle and looks to +x, the others in a corner.
    fn empty() -> Arena {
        let mut arena = Arena::default();
        arena.shooters[1].place = Vec2::new(-9.0, -9.0);
        arena.shooters[2].place = Vec2::new(-9.0, -8.0);
        arena
    }

    fn target_at(x: f32, y: f32) -> Target {
        let mut target = Target {
            num_to_come: 1,
            ..Target::default()
        };
        target.appear(Vec2::new(x, y), 10);
        target
    }

    fn near(found: f32, metres: f32) -> bool {
        (found * REACH - metres).abs() < 1e-4
    }

    #[test]
    fn an_empty_arena_ends_at_its_border() {
        let view = Rays::look(&empty(), 0);
        assert!(near(view.walls[MIDDLE], HALF_SIZE));
        assert!(near(view.walls[0], HALF_SIZE / 40_f32.to_radians().cos()));
        assert_eq!(
            (view.targets, view.others),
            ([1.0; NUM_RAYS], [1.0; NUM_RAYS])
        );
        assert_eq!(aim(&empty(), 0).0, Hit::Wall);
    }

    #[test]
    fn rays_go_from_left_to_right() {
        let mut arena = empty();
        let left = Vec2::from_angle(12_f32.to_radians()) * 6.0;
        arena.targets[1] = target_at(left.x, left.y);
        let right = Vec2::from_angle(-20_f32.to_radians()) * 6.0;
        arena.shooters[2].place = right;
        let view = Rays::look(&arena, 0);
        assert!(near(
            view.targets[MIDDLE - 3],
            6.0 - target::RADIUS - BEAM_RADIUS
        ));
        assert!(near(
            view.others[MIDDLE + 5],
            6.0 - shooter::RADIUS - BEAM_RADIUS
        ));
        assert_eq!(view.targets[MIDDLE], 1.0);
        assert_eq!(aim(&arena, 0).0, Hit::Wall);
        arena.shooters[0].heading = 12_f32.to_radians();
        assert_eq!(aim(&arena, 0).0, Hit::Target(1));
        arena.shooters[0].heading = -20_f32.to_radians();
        assert_eq!(aim(&arena, 0).0, Hit::Other);
    }

    #[test]
    fn walls_hide_and_the_nearest_is_hit() {
        let mut arena = empty();
        arena.targets[0] = target_at(8.0, 0.0);
        arena.targets[2] = target_at(5.0, 0.0);
        assert_eq!(aim(&arena, 0).0, Hit::Target(2));
        arena.shooters[1].place = Vec2::new(3.0, 0.0);
        assert_eq!(aim(&arena, 0).0, Hit::Other);
        arena.walls = vec![Aabb2d::new(Vec2::new(2.0, 0.0), Vec2::new(0.25, 1.0))];
        let view = Rays::look(&arena, 0);
        assert!(near(view.walls[MIDDLE], 1.75));
        assert_eq!((view.targets[MIDDLE], view.others[MIDDLE]), (1.0, 1.0));
        assert_eq!(aim(&arena, 0).0, Hit::Wall);
    }

    #[test]
    fn what_is_hidden_is_not_seen() {
        let mut arena = empty();
        arena.targets[0] = target_at(5.0, 0.0);
        arena.targets[0].is_up = false;
        assert_eq!(Rays::look(&arena, 0).targets, [1.0; NUM_RAYS]);
    }

    /// Marches along a ray in small steps until it is in a wall or outside: another way to measure.
    fn march(arena: &Arena, origin: Vec2, direction: Vec2) -> f32 {
        let step = 1e-3;
        let is_free = |place: Vec2| {
            let is_out = |wall: &Aabb2d| wall.closest_point(place) != place;
            place.abs().max_element() < HALF_SIZE && arena.walls.iter().all(is_out)
        };
        let places = (1..).map(|number| number as f32 * step);
        places
            .take_while(|distance| is_free(origin + direction * *distance))
            .last()
            .unwrap_or(0.0)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn rays_agree_with_marching(seed: u64, heading in -PI..PI) {
            let mut world = LudusWorld::new(0, seed);
            let mut arena = Arena::begin(&mut world, 15.0);
            arena.shooters[0].heading = heading;
            let Shooter { place, .. } = arena.shooters[0];
            let found = Rays::look(&arena, 0).walls[MIDDLE] * REACH;
            let marched = march(&arena, place, Vec2::from_angle(heading));
            // A ray may graze a corner between two steps of the march.
            let grazes = march(&arena, place + Vec2::from_angle(heading).perp() * 0.002, Vec2::from_angle(heading));
            prop_assert!((found - marched).abs() < 0.01 || (found - grazes).abs() < 0.01);
        }

        #[test]
        fn what_the_middle_ray_sees_is_what_a_shot_hits(seed: u64, heading in -PI..PI) {
            let mut world = LudusWorld::new(0, seed);
            let mut arena = Arena::begin(&mut world, 15.0);
            arena.targets[0] = target_at(world.random.range(-9.0..9.0), world.random.range(-9.0..9.0));
            arena.shooters[0].heading = heading;
            let view = Rays::look(&arena, 0);
            let (target, other) = (view.targets[MIDDLE], view.others[MIDDLE]);
            let expected = match aim(&arena, 0).0 {
                Hit::Target(number) => number == 0 && target < 1.0 && target <= other,
                Hit::Other => other < 1.0 && other < target,
                Hit::Wall => target == 1.0 && other == 1.0,
            };
            prop_assert!(expected, "{view:?}");
            let numbers = view.walls.iter().chain(&view.targets).chain(&view.others);
            prop_assert!(numbers.copied().all(|number| (0.0..=1.0).contains(&number)));
        }
    }
}
