//! Targets: discs that appear somewhere, wait to be shot, and hide again.

use bevy_ludus::prelude::RandomStream;
use bevy_math::Vec2;
use bevy_math::bounding::BoundingCircle;

/// Of a target, metres.
pub const RADIUS: f32 = 0.35;
/// Longest pause between two targets of one stand, steps.
const LONGEST_PAUSE: u64 = 15;

/// A stand that shows one target after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Target {
    /// Where the target is that is up, or was up last.
    pub place: Vec2,
    /// Whether it can be seen and hit.
    pub is_up: bool,
    /// Steps until it appears or hides.
    pub steps_left: u32,
    /// How many are still to appear here.
    pub num_to_come: u32,
}

impl Target {
    /// Makes a stand whose first target appears soon.
    pub fn new(num_to_come: u32, random: &mut RandomStream) -> Self {
        let mut target = Self {
            num_to_come,
            ..Self::default()
        };
        target.hide(random);
        target
    }

    /// Returns the disc.
    pub fn circle(&self) -> BoundingCircle {
        BoundingCircle::new(self.place, RADIUS)
    }

    /// Returns whether none is up, and none will be.
    pub fn is_over(&self) -> bool {
        !self.is_up && self.num_to_come == 0
    }

    /// Takes the target away, as it was hit or its time is over; the next one comes after a pause.
    pub fn hide(&mut self, random: &mut RandomStream) {
        self.is_up = false;
        self.steps_left = 1 + random.below(LONGEST_PAUSE) as u32;
    }

    /// Lets a step pass, and returns whether a target must appear now.
    pub fn pass_step(&mut self, random: &mut RandomStream) -> bool {
        if self.is_over() {
            return false;
        }
        self.steps_left -= 1;
        if self.steps_left > 0 {
            return false;
        }
        if self.is_up {
            self.hide(random);
        }
        !self.is_up && self.num_to_come > 0 && self.steps_left == 0
    }

    /// Shows the next target for a number of steps.
    pub fn appear(&mut self, place: Vec2, num_steps: u32) {
        self.place = place;
        self.is_up = true;
        self.steps_left = num_steps.max(1);
        self.num_to_come -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stand_shows_every_target_for_its_time() {
        let mut random = RandomStream::new(3);
        let mut stand = Target::new(4, &mut random);
        let (mut num_shown, mut steps_up, mut steps_hidden) = (0, 0, 0);
        while !stand.is_over() {
            if stand.pass_step(&mut random) {
                stand.appear(Vec2::X, 7);
                num_shown += 1;
            }
            steps_up += u32::from(stand.is_up);
            steps_hidden += u32::from(!stand.is_up);
            assert!(steps_up + steps_hidden < 1000, "{stand:?}");
        }
        assert_eq!((num_shown, steps_up), (4, 4 * 7));
        // One of them is the step in which the last target has hidden.
        assert!((4..=4 * LONGEST_PAUSE as u32 + 1).contains(&steps_hidden));
    }

    #[test]
    fn a_hit_makes_room_for_the_next_one() {
        let mut random = RandomStream::new(3);
        let mut stand = Target::new(2, &mut random);
        stand.appear(Vec2::X, 100);
        stand.hide(&mut random);
        assert!(!stand.is_up && !stand.is_over());
        stand.appear(Vec2::Y, 100);
        stand.hide(&mut random);
        assert!(stand.is_over());
        assert!(!stand.pass_step(&mut random));
    }
}
