//! What an agent is made of.

use bevy_ecs::prelude::*;

/// An entity that observes and acts.
///
/// Spawn it with [`InWorld`](crate::world::InWorld); its [`Action`] and [`Observation`] come by
/// themselves. A `Name` becomes its path in the spec.
#[derive(Component, Clone, Debug, PartialEq, Eq)]
#[require(Reward, Episode)]
pub struct Agent {
    /// Name of its policy: agents of one policy share a network and one spec.
    pub policy: String,
}

impl Agent {
    /// Makes an agent of a policy.
    #[must_use]
    pub fn of(policy: impl Into<String>) -> Self {
        Self {
            policy: policy.into(),
        }
    }
}

/// What an agent sees. The game fills it in the schedule `Observe`.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation<O: Send + Sync + 'static>(pub O);

/// What an agent has decided. It is there before the schedule `Act`, and stays during all ticks of
/// the step.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Action<A: Send + Sync + 'static>(pub A);

/// Reward since the last step. The game adds to it or sets it; Ludus takes it and sets it to 0.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Reward(pub f32);

/// What an agent may choose, one byte per alternative of all its choices, 1 = allowed. Only with
/// [`Policy::with_action_mask`](crate::policy::Policy::with_action_mask). The game fills it in the
/// schedule `Observe`.
#[derive(Component, Clone, Debug, Default, PartialEq, Eq)]
pub struct ActionMask(pub Vec<u8>);

/// State of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    /// Nothing acts: there was no reset yet, or the others of the world play on.
    #[default]
    Waiting,
    /// It is about to begin, in the schedule `Reset`.
    Beginning,
    Playing,
    Terminated,
    Truncated,
}

/// An agent's episode.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Episode {
    phase: Phase,
    steps: u32,
}

impl Episode {
    /// Ends the episode: the agent has won, lost or died.
    pub fn terminate(&mut self) {
        if self.is_playing() {
            self.phase = Phase::Terminated;
        }
    }

    /// Cuts the episode off: it could have gone on.
    pub fn truncate(&mut self) {
        if self.phase == Phase::Playing {
            self.phase = Phase::Truncated;
        }
    }

    /// Returns how many steps the episode has had.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Returns whether the episode begins now: in the schedule `Reset`, and in `Observe` after it.
    #[inline]
    #[must_use]
    pub fn is_beginning(&self) -> bool {
        self.phase == Phase::Beginning
    }

    /// Returns whether the agent acts.
    #[inline]
    #[must_use]
    pub fn is_playing(&self) -> bool {
        matches!(self.phase, Phase::Playing | Phase::Truncated)
    }

    pub(crate) fn begin(&mut self) {
        *self = Self {
            phase: Phase::Beginning,
            steps: 0,
        };
    }

    pub(crate) fn note_begun(&mut self) {
        if self.is_beginning() {
            self.phase = Phase::Playing;
        }
    }

    /// Counts a step and returns whether the episode has ended with it: (terminated, truncated).
    pub(crate) fn count_step(&mut self, limit: u32) -> (bool, bool) {
        self.steps += 1;
        let is_terminated = self.phase == Phase::Terminated;
        let is_truncated = self.phase == Phase::Truncated || self.steps >= limit;
        if is_terminated || is_truncated {
            self.phase = Phase::Waiting;
        }
        (is_terminated, is_truncated && !is_terminated)
    }
}

/// The fixed place of an agent in the arrays of its policy.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    pub(crate) policy: usize,
    pub(crate) index: usize,
}

impl Slot {
    /// Returns the index of the policy, in the order in which policies were added.
    #[must_use]
    pub fn policy(self) -> usize {
        self.policy
    }

    /// Returns the index in the policy's arrays.
    #[must_use]
    pub fn index(self) -> usize {
        self.index
    }
}
