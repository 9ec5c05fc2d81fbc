//! What a step has brought, and how the next episodes begin.

use crate::components::{Agent, Episode, Reward, Slot};
use crate::error::GameError;
use crate::opening::respawn_world;
use crate::policy::Policies;
use crate::roster::assign_slot;
use crate::stage::Stage;
use crate::wire::EpisodeMode;
use crate::world::{InWorld, LudusWorld};
use bevy_ecs::prelude::*;

/// Collects rewards and ends of episodes. Agents whose episode has ended are left inactive.
pub(crate) fn collect(
    mut stage: ResMut<Stage>,
    mut agents: Query<(&Slot, &mut Reward, &mut Episode)>,
) {
    stage.clear_outcomes();
    let Stage {
        batch,
        rosters,
        ended,
        ..
    } = &mut *stage;
    let (layout, bytes, _) = batch.parts_mut();
    for (slot, mut reward, mut episode) in &mut agents {
        let roster = &mut rosters[slot.policy];
        let taken = std::mem::take(&mut reward.0);
        if roster.active[slot.index] == 0 {
            continue;
        }
        let arrays = &layout.policies[slot.policy];
        bytes[arrays.reward.row(slot.index)].copy_from_slice(&taken.to_le_bytes());
        let (is_terminated, is_truncated) = episode.count_step(roster.max_steps);
        if is_terminated || is_truncated {
            bytes[arrays.terminated.start + slot.index] = u8::from(is_terminated);
            bytes[arrays.truncated.start + slot.index] = u8::from(is_truncated);
            roster.active[slot.index] = 0;
            ended.push(*slot);
        }
    }
    collect_lost(&mut stage);
    stage
        .ended
        .sort_unstable_by_key(|slot| (slot.policy, slot.index));
    keep_finals(&mut stage);
}

/// Ends the episodes of agents that have left.
fn collect_lost(stage: &mut Stage) {
    for slot in std::mem::take(&mut stage.lost) {
        if std::mem::take(&mut stage.rosters[slot.policy].active[slot.index]) == 1 {
            let (layout, bytes, _) = stage.batch.parts_mut();
            bytes[layout.policies[slot.policy].terminated.start + slot.index] = 1;
            stage.clear_row(slot);
            stage.ended.push(slot);
        }
    }
}

fn keep_finals(stage: &mut Stage) {
    if stage.is_encoding {
        for slot in &stage.ended {
            stage.batch.keep_final(slot.policy, slot.index);
        }
    }
}

/// Marks the episodes that begin after a step. The schedule `Reset` then sets them up.
pub(crate) fn mark_next(world: &mut World, mode: EpisodeMode) -> Result<(), GameError> {
    world.resource_scope(|world, mut stage: Mut<Stage>| {
        admit_newcomers(world, &mut stage);
        let ended = stage.ended.clone();
        let is_alone = stage.slots_per_world() == 1;
        let mut emptied: Vec<usize> = Vec::new();
        for slot in ended {
            let number = stage.world_of(slot);
            match stage.rosters[slot.policy].agents[slot.index] {
                Some(agent) if mode == EpisodeMode::Agent => {
                    begin_in_world(world, &mut stage, number, is_alone);
                    begin_agent(world, &mut stage, agent, slot);
                }
                _ => emptied.push(number),
            }
        }
        // Slots come by policy: the worlds of one policy lie side by side, so that the first pass
        // leaves little to sort.
        emptied.dedup();
        emptied.sort_unstable();
        emptied.dedup();
        emptied.retain(|number| !stage.has_active(*number));
        emptied
            .into_iter()
            .try_for_each(|number| begin_world(world, &mut stage, number))
    })
}

/// Marks that all agents of a world begin an episode. A world that has lost or won agents is
/// rebuilt first.
pub(crate) fn begin_world(
    world: &mut World,
    stage: &mut Stage,
    number: usize,
) -> Result<(), GameError> {
    if !stage.is_complete(number) {
        respawn_world(world, stage, number)?;
    }
    begin_in_world(world, stage, number, true);
    for slot in stage.slots_of(number) {
        if let Some(agent) = stage.rosters[slot.policy].agents[slot.index] {
            begin_agent(world, stage, agent, slot);
        }
    }
    Ok(())
}

fn begin_in_world(world: &mut World, stage: &mut Stage, number: usize, is_of_all: bool) {
    let entity = stage.worlds[number];
    if let Some(mut ludus_world) = world.get_mut::<LudusWorld>(entity) {
        ludus_world.begin_episode(is_of_all);
        stage.beginning.push(entity);
    }
}

fn begin_agent(world: &mut World, stage: &mut Stage, agent: Entity, slot: Slot) {
    if let Some(mut episode) = world.get_mut::<Episode>(agent) {
        episode.begin();
        stage.beginning.push(agent);
        stage.rosters[slot.policy].active[slot.index] = 1;
    }
    if let Some(mut reward) = world.get_mut::<Reward>(agent) {
        reward.0 = 0.0;
    }
}

/// Notes that the episodes have begun.
pub(crate) fn note_begun(world: &mut World) {
    world.resource_scope(|world, mut stage: Mut<Stage>| {
        for entity in stage.beginning.drain(..) {
            if let Some(mut episode) = world.get_mut::<Episode>(entity) {
                episode.note_begun();
            } else if let Some(mut ludus_world) = world.get_mut::<LudusWorld>(entity) {
                ludus_world.note_begun();
            }
        }
    });
}

/// Gives agents that were spawned since the last step a free slot of their world.
fn admit_newcomers(world: &mut World, stage: &mut Stage) {
    for agent in std::mem::take(&mut stage.newcomers) {
        if let Some(slot) = free_slot(world, stage, agent) {
            let policies = world.resource::<Policies>().clone();
            stage.rosters[slot.policy].agents[slot.index] = Some(agent);
            assign_slot(world, &policies, agent, slot);
            begin_agent(world, stage, agent, slot);
        }
    }
}

/// Finds a free slot, unless the agent has gone or has one. That there is none is an error.
fn free_slot(world: &World, stage: &mut Stage, entity: Entity) -> Option<Slot> {
    let agent = world.get::<Agent>(entity)?;
    if world.get::<Slot>(entity).is_some() {
        return None;
    }
    let home = world.get::<InWorld>(entity).map(|home| home.0);
    let number = home.and_then(|home| stage.worlds.iter().position(|own| *own == home));
    let policy = world.resource::<Policies>().find(&agent.policy);
    let is_free = |slot: &Slot| {
        let roster = &stage.rosters[slot.policy];
        Some(slot.policy) == policy
            && roster.agents[slot.index].is_none()
            && roster.active[slot.index] == 0
    };
    let slot = number.and_then(|number| stage.slots_of(number).into_iter().find(is_free));
    if slot.is_none() {
        stage.error = Some(GameError::NoFreeSlot(agent.policy.clone()));
    }
    slot
}
