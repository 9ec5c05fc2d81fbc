//! The worlds of one app, and the arrays that hold all that goes in and out of them.

use crate::components::Slot;
use crate::error::GameError;
use crate::roster::Roster;
use crate::wire::{ActionFrame, ActionLayout, BatchFrame, BatchLayout, EpisodeMode, Spec};
use bevy_ecs::prelude::*;
use std::time::Duration;
use web_time::Instant;

/// What the game says about all its worlds.
#[derive(Resource, Clone, Debug)]
pub(crate) struct Settings {
    pub name: String,
    pub ticks_per_step: u32,
    pub episode: EpisodeMode,
    /// Whether this is the app of one isolated world.
    pub is_isolated: bool,
}

/// Which observations are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Those of all agents that act.
    All,
    /// Those of agents that begin an episode.
    Beginning,
}

/// The worlds of one app.
#[derive(Resource, Debug)]
pub(crate) struct Stage {
    pub spec: Spec,
    pub actions: ActionFrame,
    pub batch: BatchFrame,
    /// By policy.
    pub rosters: Vec<Roster>,
    pub worlds: Vec<Entity>,
    pub pass: Pass,
    /// Whether observations go into the batch; not so while the ceiling is measured.
    pub is_encoding: bool,
    /// Whether this update of the app is a step.
    pub is_stepping: bool,
    /// Slots whose episodes have ended in this step, ascending.
    pub ended: Vec<Slot>,
    /// Agents and worlds whose episodes begin.
    pub beginning: Vec<Entity>,
    /// Agents that were spawned since the last step.
    pub newcomers: Vec<Entity>,
    /// Slots whose agents were despawned since the last step.
    pub lost: Vec<Slot>,
    /// Whether worlds are being rebuilt, so that no agent joins or leaves.
    pub is_rebuilding: bool,
    pub num_ticks: u64,
    /// Since when the game's ticks run.
    pub applied_at: Instant,
    /// Time that the last step's ticks took.
    pub game_time: Duration,
    /// Time that Ludus took around them.
    pub bridge_time: Duration,
    /// The game's own mistake; the run fails with it.
    pub error: Option<GameError>,
}

impl Stage {
    pub fn new(spec: Spec, rosters: Vec<Roster>, worlds: Vec<Entity>) -> Self {
        Self {
            actions: ActionFrame::new(ActionLayout::new(&spec)),
            batch: BatchFrame::new(BatchLayout::new(&spec)),
            spec,
            rosters,
            worlds,
            pass: Pass::All,
            is_encoding: true,
            is_stepping: false,
            ended: Vec::new(),
            beginning: Vec::new(),
            newcomers: Vec::new(),
            lost: Vec::new(),
            is_rebuilding: false,
            num_ticks: 0,
            applied_at: Instant::now(),
            game_time: Duration::ZERO,
            bridge_time: Duration::ZERO,
            error: None,
        }
    }

    /// Forgets rewards and ends of the last step.
    pub fn clear_outcomes(&mut self) {
        let (layout, bytes, finals) = self.batch.parts_mut();
        for (policy, finals) in layout.policies.iter().zip(finals) {
            for array in [policy.reward, policy.terminated, policy.truncated] {
                bytes[array.rows(0..policy.num_agents)].fill(0);
            }
            finals.clear();
        }
        self.ended.clear();
    }

    /// Sets the observations of slots to zeros whose episode has ended, and no other has begun.
    pub fn clear_ended_rows(&mut self) {
        for number in 0..self.ended.len() {
            let slot = self.ended[number];
            if self.rosters[slot.policy].active[slot.index] == 0 {
                self.clear_row(slot);
            }
        }
    }

    /// Sets the observation of a slot to zeros.
    pub fn clear_row(&mut self, slot: Slot) {
        let (layout, bytes, _) = self.batch.parts_mut();
        for entry in &layout.policies[slot.policy].entries {
            bytes[entry.row(slot.index)].fill(0);
        }
    }

    /// Writes which slots act into the batch.
    pub fn write_active(&mut self) {
        let (layout, bytes, _) = self.batch.parts_mut();
        for (policy, roster) in layout.policies.iter().zip(&self.rosters) {
            bytes[policy.active.rows(0..policy.num_agents)].copy_from_slice(&roster.active);
        }
    }

    /// Returns the world in which a slot is.
    pub fn world_of(&self, slot: Slot) -> usize {
        slot.index / self.rosters[slot.policy].per_world
    }

    /// Returns how many slots a world has, of all policies.
    pub fn slots_per_world(&self) -> usize {
        self.rosters.iter().map(|roster| roster.per_world).sum()
    }

    /// Returns all slots of a world.
    pub fn slots_of(&self, world: usize) -> Vec<Slot> {
        let slots = |(policy, roster): (usize, &Roster)| {
            let first = world * roster.per_world;
            (first..first + roster.per_world).map(move |index| Slot { policy, index })
        };
        self.rosters.iter().enumerate().flat_map(slots).collect()
    }

    /// Returns whether some slot of a world acts.
    pub fn has_active(&self, world: usize) -> bool {
        self.slots_of(world)
            .iter()
            .any(|slot| self.rosters[slot.policy].active[slot.index] == 1)
    }

    /// Returns whether a world has exactly the agents that it begins with.
    pub fn is_complete(&self, world: usize) -> bool {
        self.slots_of(world).iter().all(|slot| {
            let roster = &self.rosters[slot.policy];
            let is_spare = slot.index % roster.per_world >= roster.per_world - roster.num_spare;
            roster.agents[slot.index].is_none() == is_spare
        })
    }
}
