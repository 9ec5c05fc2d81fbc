//! The systems that carry rows between components and arrays.

use crate::components::{Action, ActionMask, Agent, Episode, Observation, Slot};
use crate::error::GameError;
use crate::space::{ActionSpace, ObservationSpace, RowReader, RowWriter};
use crate::stage::{Pass, Stage};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;

/// Reads the actions, before the schedule `Act`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub(crate) struct ReadActions;

/// Writes the observations, after the schedule `Observe`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub(crate) struct WriteRows;

pub(crate) fn read_actions<A: ActionSpace>(
    stage: Res<Stage>,
    mut agents: Query<(&Slot, &mut Action<A>)>,
) {
    for (slot, mut action) in &mut agents {
        if stage.rosters[slot.policy].active[slot.index] == 1 {
            action.0 = A::read(&mut RowReader::new(
                stage.actions.row(slot.policy, slot.index),
            ));
        }
    }
}

/// Writes rows table by table: agents of one kind lie side by side in memory.
pub(crate) fn write_observations<O: ObservationSpace>(
    mut stage: ResMut<Stage>,
    agents: Query<(&Slot, &Observation<O>, &Episode)>,
) {
    if !stage.is_encoding {
        return;
    }
    let Ok(tables) = agents.contiguous_iter() else {
        debug_assert!(false, "components of agents lie in tables");
        return;
    };
    let Stage {
        batch,
        rosters,
        pass,
        ..
    } = &mut *stage;
    let (layout, bytes, _) = batch.parts_mut();
    for (slots, observations, episodes) in tables {
        let rows = slots.iter().zip(observations);
        let mut write = |(slot, observation): (&Slot, &Observation<O>)| {
            let entries = &layout.policies[slot.policy].entries;
            let mut row = RowWriter::new(bytes, entries, slot.index);
            observation.0.write(&mut row);
        };
        match pass {
            Pass::All => rows
                .filter(|(slot, _)| rosters[slot.policy].active[slot.index] == 1)
                .for_each(&mut write),
            Pass::Beginning => rows
                .zip(episodes)
                .filter(|(_, episode)| episode.is_beginning())
                .for_each(|(row, _)| write(row)),
        }
    }
}

/// Writes the masks of all agents that have one; inactive slots may do everything.
pub(crate) fn write_masks(mut stage: ResMut<Stage>, agents: Query<(&Slot, &ActionMask)>) {
    let Stage {
        batch,
        rosters,
        spec,
        error,
        ..
    } = &mut *stage;
    let (layout, bytes, _) = batch.parts_mut();
    for policy in &layout.policies {
        bytes[policy.mask.rows(0..policy.num_agents)].fill(1);
    }
    for (slot, mask) in &agents {
        let row = &mut bytes[layout.policies[slot.policy].mask.row(slot.index)];
        if row.is_empty() || rosters[slot.policy].active[slot.index] == 0 {
            continue;
        }
        if mask.0.len() == row.len() {
            row.copy_from_slice(&mask.0);
        } else {
            let place = rosters[slot.policy].place(&spec.policies[slot.policy].name, slot.index);
            let (expected, got) = (row.len(), mask.0.len());
            *error = Some(GameError::MaskSize {
                place,
                expected,
                got,
            });
        }
    }
}

/// Notes an agent that was spawned in the middle of training.
pub(crate) fn note_newcomer(add: On<Add, Agent>, stage: Option<ResMut<Stage>>) {
    if let Some(mut stage) = stage
        && !stage.is_rebuilding
    {
        stage.newcomers.push(add.entity);
    }
}

/// Notes an agent that was despawned in the middle of training.
pub(crate) fn note_leaver(
    remove: On<Remove, Slot>,
    slots: Query<&Slot>,
    stage: Option<ResMut<Stage>>,
) {
    if let (Some(mut stage), Ok(slot)) = (stage, slots.get(remove.entity))
        && !stage.is_rebuilding
    {
        stage.rosters[slot.policy].agents[slot.index] = None;
        stage.lost.push(*slot);
    }
}
