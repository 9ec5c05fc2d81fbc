//! The arena: what is in one world, and how a step changes it.

use crate::shooter::{self, Shooter, part};
use crate::sight::{Hit, RELOAD_STEPS, aim};
use crate::target::{self, Target};
use bevy_ecs::component::Component;
use bevy_ludus::prelude::*;
use bevy_math::Vec2;
use bevy_math::bounding::Aabb2d;
use std::f32::consts::PI;

/// From the middle to each border, metres.
pub const HALF_SIZE: f32 = 10.0;
pub const NUM_SHOOTERS: usize = 3;
/// Stands, each of which shows one target after the other.
pub const NUM_STANDS: usize = 3;
/// Targets of an episode.
pub const NUM_TARGETS: u32 = 12;
/// Longest pause and time of all targets of a stand, one after the other, and some more.
pub const MAX_EPISODE_STEPS: u32 = 600;
/// How long a target stays if no shooter hits it and the trainer says nothing else, seconds.
const TARGET_SECONDS: f32 = 4.0;
/// Walls inside the arena if the trainer says nothing else: one in each quarter.
pub const MAX_WALLS: usize = 4;
/// Half of the length and of the thickness of a wall, metres.
const WALL_HALF_LENGTH: std::ops::Range<f32> = 1.5..3.5;
const WALL_HALF_WIDTH: f32 = 0.25;
/// Walls stay this far from the border and from the two lanes through the middle, metres; twice
/// a body's radius fits in between.
const LANE: f32 = 1.2;
/// Closest starts of two shooters, and of a target to a shooter, metres.
const SHOOTER_DISTANCE: f32 = 2.0;
const TARGET_DISTANCE: f32 = 3.0;
/// Places that are tried before one in the free lane is taken.
const TRIES: usize = 32;

/// Reward for a hit, for a shot at nothing, and for a shot at another shooter.
const HIT: f32 = 1.0;
const WASTE: f32 = -0.1;
const FRIENDLY_FIRE: f32 = -0.3;

/// All that is in a world. It belongs to the entity of the world.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub struct Arena {
    pub walls: Vec<Aabb2d>,
    pub shooters: [Shooter; NUM_SHOOTERS],
    pub targets: [Target; NUM_STANDS],
    /// How long a target stays, steps.
    pub target_steps: u32,
}

impl Arena {
    /// Makes an arena for a new episode.
    pub fn begin(world: &mut LudusWorld, steps_per_second: f32) -> Self {
        let num_walls = world.number("walls", MAX_WALLS as f32) as usize;
        let seconds = world.number("target_seconds", TARGET_SECONDS);
        let random = &mut world.random;
        let mut arena = Self {
            walls: (0..num_walls.min(MAX_WALLS))
                .map(|quarter| make_wall(quarter, random))
                .collect(),
            targets: [(); NUM_STANDS]
                .map(|()| Target::new(NUM_TARGETS / NUM_STANDS as u32, random)),
            target_steps: (seconds * steps_per_second).round() as u32,
            ..Self::default()
        };
        for number in 0..NUM_SHOOTERS {
            let others: Vec<_> = arena.shooters[..number]
                .iter()
                .map(|one| one.place)
                .collect();
            let place = arena.free_place(random, shooter::RADIUS, &others, SHOOTER_DISTANCE);
            arena.shooters[number] = Shooter {
                place,
                heading: random.range(-PI..PI),
                ..Shooter::default()
            };
        }
        arena
    }

    /// Lets those who shoot in this step shoot, one after the other.
    pub fn shoot(&mut self, random: &mut RandomStream) {
        for number in 0..NUM_SHOOTERS {
            let shooter = &mut self.shooters[number];
            shooter.reward = 0.0;
            shooter.shot = None;
            if !shooter.decision.is_shooting || shooter.steps_to_reload > 0 {
                continue;
            }
            shooter.steps_to_reload = RELOAD_STEPS + 1;
            let (hit, end) = aim(self, number);
            if let Hit::Target(index) = hit {
                self.targets[index].hide(random);
            }
            let shooter = &mut self.shooters[number];
            shooter.shot = Some([shooter.place, end]);
            shooter.reward = match hit {
                Hit::Target(_) => HIT,
                Hit::Other => FRIENDLY_FIRE,
                Hit::Wall => WASTE,
            };
        }
    }

    /// Moves everyone by one tick.
    pub fn advance(&mut self, seconds: f32) {
        let [one, two, three] = &mut self.shooters;
        for shooter in [&mut *one, &mut *two, &mut *three] {
            shooter.advance(seconds);
        }
        part(one, two);
        part(two, three);
        part(one, three);
        for shooter in &mut self.shooters {
            shooter.leave_walls(&self.walls, HALF_SIZE);
        }
    }

    /// Lets targets appear and hide, and rifles be reloaded, at the end of a step.
    pub fn pass_step(&mut self, random: &mut RandomStream) {
        for shooter in &mut self.shooters {
            shooter.steps_to_reload = shooter.steps_to_reload.saturating_sub(1);
        }
        for index in 0..NUM_STANDS {
            if self.targets[index].pass_step(random) {
                let shooters = self.shooters.map(|shooter| shooter.place);
                let place = self.free_place(random, target::RADIUS, &shooters, TARGET_DISTANCE);
                self.targets[index].appear(place, self.target_steps);
            }
        }
    }

    /// Returns whether all targets have come and gone.
    pub fn is_over(&self) -> bool {
        self.targets.iter().all(Target::is_over)
    }

    /// Draws a place for a disc of some radius, away from walls and from others.
    fn free_place(
        &self,
        random: &mut RandomStream,
        radius: f32,
        others: &[Vec2],
        distance: f32,
    ) -> Vec2 {
        let reach = HALF_SIZE - radius;
        let mut draw = || Vec2::new(random.range(-reach..reach), random.range(-reach..reach));
        let is_free = |place: &Vec2| {
            let is_clear = |wall: &Aabb2d| wall.closest_point(*place).distance(*place) >= radius;
            let is_away = |other: &Vec2| other.distance(*place) >= distance;
            self.walls.iter().all(is_clear) && others.iter().all(is_away)
        };
        let found = (0..TRIES).map(|_| draw()).find(is_free);
        found.unwrap_or_else(|| Vec2::new(draw().x, 0.0))
    }
}

/// Draws a wall inside a quarter of the arena, along one of the axes.
fn make_wall(quarter: usize, random: &mut RandomStream) -> Aabb2d {
    let length = random.range(WALL_HALF_LENGTH);
    let half_size = if random.below(2) == 0 {
        Vec2::new(length, WALL_HALF_WIDTH)
    } else {
        Vec2::new(WALL_HALF_WIDTH, length)
    };
    let low = Vec2::splat(LANE) + half_size;
    let high = Vec2::splat(HALF_SIZE - LANE) - half_size;
    let place = Vec2::new(random.range(low.x..high.x), random.range(low.y..high.y));
    let sides = [
        Vec2::ONE,
        Vec2::new(-1.0, 1.0),
        Vec2::NEG_ONE,
        Vec2::new(1.0, -1.0),
    ];
    Aabb2d::new(place * sides[quarter % sides.len()], half_size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooter::{Decision, Turn, Walk};
    use proptest::prelude::*;

    const TICK: f32 = 1.0 / 30.0;

    fn begun(seed: u64) -> (Arena, RandomStream) {
        let mut world = LudusWorld::new(0, seed);
        (Arena::begin(&mut world, 15.0), world.random)
    }

    fn draw(random: &mut RandomStream) -> Decision {
        let walks = [
            Walk::Stay,
            Walk::Forward,
            Walk::Back,
            Walk::Left,
            Walk::Right,
        ];
        let turns = [
            Turn::Straight,
            Turn::Left,
            Turn::Right,
            Turn::FastLeft,
            Turn::FastRight,
        ];
        Decision {
            walk: walks[random.below(5) as usize],
            turn: turns[random.below(5) as usize],
            is_shooting: random.below(2) == 1,
        }
    }

    /// Plays a whole episode at random, and looks at the arena after every step.
    fn play(seed: u64, mut check: impl FnMut(&Arena)) -> u32 {
        let (mut arena, mut random) = begun(seed);
        let mut num_steps = 0;
        while !arena.is_over() {
            for number in 0..NUM_SHOOTERS {
                arena.shooters[number].decision = draw(&mut random);
            }
            arena.shoot(&mut random);
            arena.advance(TICK);
            arena.advance(TICK);
            arena.pass_step(&mut random);
            check(&arena);
            num_steps += 1;
            assert!(num_steps < MAX_EPISODE_STEPS, "{arena:?}");
        }
        num_steps
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn nobody_leaves_the_arena_or_walks_through_walls(seed: u64) {
            play(seed, |arena| {
                for shooter in &arena.shooters {
                    assert!(shooter.place.abs().max_element() <= HALF_SIZE - shooter::RADIUS);
                    for wall in &arena.walls {
                        let distance = wall.closest_point(shooter.place).distance(shooter.place);
                        assert!(distance > shooter::RADIUS - 1e-4, "{distance} m: {arena:?}");
                    }
                }
            });
        }

        #[test]
        fn an_episode_shows_all_targets_where_there_is_room(seed: u64) {
            let mut num_seen = 0;
            let mut was_up = [false; NUM_STANDS];
            play(seed, |arena| {
                for (target, was_up) in arena.targets.iter().zip(&mut was_up) {
                    let is_new = target.is_up && (!*was_up || target.steps_left == arena.target_steps);
                    num_seen += u32::from(is_new);
                    *was_up = target.is_up;
                    let is_clear = |wall: &Aabb2d| {
                        wall.closest_point(target.place).distance(target.place) >= target::RADIUS
                    };
                    assert!(!target.is_up || arena.walls.iter().all(is_clear), "{arena:?}");
                }
            });
            prop_assert_eq!(num_seen, NUM_TARGETS);
        }

        #[test]
        fn equal_seeds_play_equal_episodes(seed: u64) {
            let history = |seed| {
                let mut seen = Vec::new();
                play(seed, |arena| seen.push(arena.clone()));
                seen
            };
            prop_assert_eq!(history(seed), history(seed));
        }
    }

    #[test]
    fn walls_stand_apart_in_their_quarters() {
        for seed in 0..200 {
            let (arena, _) = begun(seed);
            assert_eq!(arena.walls.len(), MAX_WALLS);
            for (wall, side) in arena.walls.iter().zip([(1, 1), (-1, 1), (-1, -1), (1, -1)]) {
                let (x, y) = (wall.min.x.signum(), wall.min.y.signum());
                assert_eq!((x as i32, y as i32), side);
                for corner in [wall.min, wall.max] {
                    let low = corner.abs().min_element();
                    assert!(
                        low >= LANE - 1e-5 && corner.abs().max_element() <= HALF_SIZE - LANE + 1e-5
                    );
                }
            }
        }
    }

    #[test]
    fn shots_are_rewarded_and_the_rifle_must_be_reloaded() {
        let (mut arena, mut random) = begun(0);
        arena.walls.clear();
        let places = [(0.0, 0.0), (-5.0, 0.0), (0.0, -5.0)];
        for (shooter, (x, y)) in arena.shooters.iter_mut().zip(places) {
            shooter.place = Vec2::new(x, y);
            shooter.heading = 0.0;
            shooter.decision.is_shooting = true;
        }
        arena.targets[1].appear(Vec2::new(6.0, 0.0), 50);
        arena.shoot(&mut random);
        let rewards = arena.shooters.map(|shooter| shooter.reward);
        assert_eq!(rewards, [HIT, FRIENDLY_FIRE, WASTE]);
        assert!(!arena.targets[1].is_up);
        for step in 1..=RELOAD_STEPS {
            arena.pass_step(&mut random);
            arena.shoot(&mut random);
            let rewards = arena.shooters.map(|shooter| shooter.reward);
            assert_eq!(rewards, [0.0; NUM_SHOOTERS], "{step}");
        }
        arena.pass_step(&mut random);
        arena.shoot(&mut random);
        assert!(arena.shooters.iter().all(|shooter| shooter.reward != 0.0));
    }

    #[test]
    fn the_trainer_chooses_walls_and_how_long_targets_stay() {
        let mut world = LudusWorld::new(0, 1);
        world.parameters.insert("walls".to_owned(), 2.into());
        world
            .parameters
            .insert("target_seconds".to_owned(), 2.5.into());
        let arena = Arena::begin(&mut world, 15.0);
        assert_eq!((arena.walls.len(), arena.target_steps), (2, 38));
    }
}
