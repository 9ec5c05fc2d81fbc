//! Those who shoot: how they turn and walk.

use bevy_ludus::prelude::*;
use bevy_math::bounding::{Aabb2d, BoundingCircle};
use bevy_math::{Rot2, Vec2};
use std::f32::consts::PI;

/// Of a body, metres.
pub const RADIUS: f32 = 0.4;
/// Of walking, in every direction, m/s.
const SPEED: f32 = 4.0;
/// Of the small and of the large turn, radians per second; at 15 steps a second 4° and 16° a step.
const SLOW_TURN: f32 = PI / 3.0;
const FAST_TURN: f32 = 4.0 * SLOW_TURN;

/// What a shooter decides for one step.
#[derive(ActionSpace, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Decision {
    pub walk: Walk,
    pub turn: Turn,
    #[ludus(name = "shoot")]
    pub is_shooting: bool,
}

/// Where to walk, as seen by the shooter.
#[derive(ActionSpace, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Walk {
    #[default]
    Stay,
    Forward,
    Back,
    Left,
    Right,
}

/// How to turn.
#[derive(ActionSpace, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Turn {
    #[default]
    Straight,
    Left,
    Right,
    FastLeft,
    FastRight,
}

/// A shooter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shooter {
    /// Metres from the middle of the arena.
    pub place: Vec2,
    /// Where it looks: counterclockwise from +x, radians from −π to π.
    pub heading: f32,
    /// Steps until it may shoot again.
    pub steps_to_reload: u32,
    /// What it does in this step.
    pub decision: Decision,
    /// What this step has brought.
    pub reward: f32,
    /// From where to where it shot in this step.
    pub shot: Option<[Vec2; 2]>,
}

impl Shooter {
    /// Returns the body.
    pub fn circle(&self) -> BoundingCircle {
        BoundingCircle::new(self.place, RADIUS)
    }

    /// Returns the rotation from +x to where it looks.
    pub fn rotation(&self) -> Rot2 {
        Rot2::radians(self.heading)
    }

    /// Turns and walks for one tick, through whatever is there.
    pub fn advance(&mut self, seconds: f32) {
        let heading = self.heading + self.decision.turn.speed() * seconds;
        self.heading = heading - 2.0 * PI * (heading / (2.0 * PI)).round();
        self.place += self.rotation() * self.decision.walk.direction() * SPEED * seconds;
    }

    /// Moves out of walls and back into the arena; along a wall one slides.
    pub fn leave_walls(&mut self, walls: &[Aabb2d], half_size: f32) {
        for wall in walls {
            let away = self.place - wall.closest_point(self.place);
            let distance = away.length();
            if distance > 0.0 && distance < RADIUS {
                self.place += away * (RADIUS / distance - 1.0);
            }
        }
        let reach = Vec2::splat(half_size - RADIUS);
        self.place = self.place.clamp(-reach, reach);
    }
}

/// Pushes two bodies that overlap apart, each by half.
pub fn part(one: &mut Shooter, other: &mut Shooter) {
    let apart = other.place - one.place;
    let distance = apart.length();
    if distance > 0.0 && distance < 2.0 * RADIUS {
        let push = apart * (RADIUS / distance - 0.5);
        one.place -= push;
        other.place += push;
    }
}

impl Walk {
    /// Returns the direction where +x is ahead and +y left; zero for staying.
    fn direction(self) -> Vec2 {
        match self {
            Self::Stay => Vec2::ZERO,
            Self::Forward => Vec2::X,
            Self::Back => Vec2::NEG_X,
            Self::Left => Vec2::Y,
            Self::Right => Vec2::NEG_Y,
        }
    }
}

impl Turn {
    /// Returns radians per second, positive to the left.
    fn speed(self) -> f32 {
        match self {
            Self::Straight => 0.0,
            Self::Left => SLOW_TURN,
            Self::Right => -SLOW_TURN,
            Self::FastLeft => FAST_TURN,
            Self::FastRight => -FAST_TURN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: f32 = 1.0 / 30.0;

    fn at(x: f32, y: f32) -> Shooter {
        Shooter {
            place: Vec2::new(x, y),
            ..Shooter::default()
        }
    }

    fn decided(walk: Walk, turn: Turn) -> Shooter {
        let decision = Decision {
            walk,
            turn,
            ..Decision::default()
        };
        Shooter {
            decision,
            ..Shooter::default()
        }
    }

    #[test]
    fn a_second_of_walking_is_four_metres_where_one_looks() {
        for (walk, expected) in [
            (Walk::Stay, Vec2::ZERO),
            (Walk::Forward, Vec2::Y),
            (Walk::Back, Vec2::NEG_Y),
            (Walk::Left, Vec2::NEG_X),
            (Walk::Right, Vec2::X),
        ] {
            let mut shooter = decided(walk, Turn::Straight);
            shooter.heading = 0.5 * PI;
            (0..30).for_each(|_| shooter.advance(TICK));
            let error = shooter.place.distance(expected * SPEED);
            assert!(error < 1e-4, "{walk:?}: {shooter:?}");
        }
    }

    #[test]
    fn turns_are_of_four_and_sixteen_degrees_a_step() {
        for (turn, degrees) in [
            (Turn::Straight, 0.0),
            (Turn::Left, 4.0),
            (Turn::Right, -4.0),
            (Turn::FastLeft, 16.0),
            (Turn::FastRight, -16.0),
        ] {
            let mut shooter = decided(Walk::Stay, turn);
            (0..2).for_each(|_| shooter.advance(TICK));
            let error = shooter.heading.to_degrees() - degrees;
            assert!(error.abs() < 1e-3, "{turn:?}: {shooter:?}");
            (0..1000).for_each(|_| shooter.advance(TICK));
            assert!(shooter.heading.abs() <= PI + 1e-5);
        }
    }

    #[test]
    fn walls_and_the_border_stop_and_let_slide() {
        let wall = Aabb2d::new(Vec2::ZERO, Vec2::new(2.0, 0.25));
        let mut shooter = at(1.0, 0.5);
        shooter.leave_walls(&[wall], 10.0);
        assert!(shooter.place.distance(Vec2::new(1.0, 0.65)) < 1e-6);
        let mut shooter = at(12.0, -3.0);
        shooter.leave_walls(&[wall], 10.0);
        assert_eq!(shooter.place, Vec2::new(9.6, -3.0));
    }

    #[test]
    fn bodies_are_pushed_apart_evenly() {
        let (mut one, mut other) = (at(0.0, 0.0), at(0.5, 0.0));
        part(&mut one, &mut other);
        assert!((one.place.x + 0.15).abs() < 1e-6 && (other.place.x - 0.65).abs() < 1e-6);
        let (mut one, mut other) = (at(0.0, 0.0), at(0.9, 0.0));
        let before = (one, other);
        part(&mut one, &mut other);
        assert_eq!((one, other), before);
    }
}
