//! Rows of single worlds are put together into one batch, and actions taken apart.

use crate::error::GameError;
use crate::stage::Stage;
use crate::wire::{ActionFrame, BatchFrame, PolicySpec, Spec};
use bevy_app::SubApp;
use bevy_ecs::prelude::*;
use std::sync::Mutex;

/// Makes the spec of all worlds of the specs of single ones, which must be alike.
pub(super) fn merge_specs(apps: &[Mutex<SubApp>]) -> Result<Spec, GameError> {
    let mut merged: Option<Spec> = None;
    for (number, app) in apps.iter().enumerate() {
        let app = app
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let own = &app.world().resource::<Stage>().spec;
        match &mut merged {
            None => merged = Some(own.clone()),
            Some(spec) => append(spec, own, number as u64)?,
        }
    }
    let spec = merged.ok_or(GameError::NoPolicy)?;
    spec.validate()?;
    Ok(spec)
}

fn append(spec: &mut Spec, own: &Spec, number: u64) -> Result<(), GameError> {
    let is_alike = |(one, other): (&PolicySpec, &PolicySpec)| {
        one.name == other.name && one.agents_per_world == other.agents_per_world
    };
    let is_fit = spec.policies.len() == own.policies.len()
        && spec.policies.iter().zip(&own.policies).all(is_alike);
    if !is_fit {
        return Err(GameError::UnlikeWorlds(number as usize));
    }
    spec.num_worlds += 1;
    for (policy, own) in spec.policies.iter_mut().zip(&own.policies) {
        policy.num_agents += own.num_agents;
        policy.agents.extend(own.agents.iter().map(|agent| {
            let mut agent = agent.clone();
            agent.world = number;
            agent
        }));
    }
    Ok(())
}

/// Hands a world its part of all actions.
pub(super) fn scatter(actions: &ActionFrame, number: usize, world: &mut World) {
    let mut stage = world.resource_mut::<Stage>();
    stage.is_stepping = true;
    let layouts = &actions.layout().policies;
    for (policy, all) in layouts.iter().enumerate() {
        let choices = stage.actions.discrete_mut(policy).as_flattened_mut();
        let start = all.discrete().start + number * choices.len();
        choices.copy_from_slice(&actions.payload()[start..start + choices.len()]);
        let numbers = stage.actions.continuous_mut(policy).as_flattened_mut();
        let start = all.continuous().start + number * numbers.len();
        numbers.copy_from_slice(&actions.payload()[start..start + numbers.len()]);
    }
}

/// Copies the rows of a world to their places among those of all worlds.
pub(super) fn gather(stage: &mut Stage, number: usize, batch: &mut BatchFrame) {
    let (layout, bytes, finals) = batch.parts_mut();
    let own_bytes = stage.batch.bytes();
    for (policy, own) in stage.batch.layout().policies.iter().enumerate() {
        let (first, count) = (number * own.num_agents, own.num_agents);
        for (array, own) in layout.policies[policy].all().zip(own.all()) {
            bytes[array.rows(first..first + count)].copy_from_slice(&own_bytes[own.rows(0..count)]);
        }
        let kept = &stage.batch.finals[policy];
        finals[policy]
            .slots
            .extend(kept.slots.iter().map(|slot| slot + first as u32));
        for (all, own) in finals[policy].entries.iter_mut().zip(&kept.entries) {
            all.extend_from_slice(own);
        }
    }
}
