//! Worlds are spawned, and the spec is made of what the game put into them.

use crate::components::Slot;
use crate::error::GameError;
use crate::policy::Policies;
use crate::roster::{Roster, assign_slot, fill_rosters};
use crate::stage::{Settings, Stage};
use crate::wire::{PolicySpec, Spec, WorldLayout};
use crate::world::LudusWorld;
use bevy_ecs::prelude::*;
use bevy_time::{Fixed, Time};

/// What the trainer wants of the worlds of one app.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Opening {
    pub num_worlds: usize,
    /// Index of the first one among all engines.
    pub first_world: u64,
    pub layout: WorldLayout,
    pub max_episode_steps: Option<u32>,
    pub ticks_per_step: Option<u32>,
}

/// Spawns the worlds of an app and describes them.
pub(crate) fn open(world: &mut World, opening: Opening) -> Result<(), GameError> {
    let worlds: Vec<_> = (0..opening.num_worlds as u64)
        .map(|number| {
            world
                .spawn(LudusWorld::new(opening.first_world + number, number))
                .id()
        })
        .collect();
    world.flush();
    let mut rosters = fill_rosters(world, &worlds)?;
    if rosters.is_empty() {
        return Err(GameError::NoPolicy);
    }
    if let Some(steps) = opening.max_episode_steps {
        rosters
            .iter_mut()
            .for_each(|roster| roster.max_steps = steps);
    }
    let spec = describe(world, opening, &rosters);
    spec.validate()?;
    world.insert_resource(Stage::new(spec, rosters, worlds));
    Ok(())
}

fn describe(world: &mut World, opening: Opening, rosters: &[Roster]) -> Spec {
    let settings = world.resource::<Settings>().clone();
    let policies = world.resource::<Policies>().clone();
    let timestep = world.get_resource_or_init::<Time<Fixed>>().timestep();
    let describe = |(roster, entry): (&Roster, &crate::policy::PolicyEntry)| -> PolicySpec {
        let mut spec = entry.to_spec(settings.episode);
        spec.max_episode_steps = opening
            .max_episode_steps
            .map(u64::from)
            .or(spec.max_episode_steps);
        roster.describe(world, 0, &mut spec);
        spec
    };
    Spec {
        num_worlds: opening.num_worlds as u64,
        layout: opening.layout,
        ticks_per_step: u64::from(opening.ticks_per_step.unwrap_or(settings.ticks_per_step)),
        // A timestep is whole nanoseconds: 60 ticks a second are 16,666,667 ns each.
        tick_rate: (1e3 / timestep.as_secs_f64()).round() / 1e3,
        scene: settings.name.clone(),
        policies: rosters
            .iter()
            .zip(&policies.entries)
            .map(describe)
            .collect(),
    }
}

/// Despawns all worlds of an app and spawns them again.
pub(crate) fn rebuild(world: &mut World) -> Result<(), GameError> {
    world.resource_mut::<Stage>().is_rebuilding = true;
    let old = std::mem::take(&mut world.resource_mut::<Stage>().worlds);
    let successors: Vec<_> = old
        .iter()
        .filter_map(|entity| world.get::<LudusWorld>(*entity).map(LudusWorld::successor))
        .collect();
    for entity in old {
        world.despawn(entity);
    }
    let worlds: Vec<_> = successors
        .into_iter()
        .map(|successor| world.spawn(successor).id())
        .collect();
    world.flush();
    let rosters = fill_rosters(world, &worlds)?;
    let mut stage = world.resource_mut::<Stage>();
    check_rebuilt(&stage, &rosters)?;
    for (own, new) in stage.rosters.iter_mut().zip(rosters) {
        (own.agents, own.active) = (new.agents, new.active);
    }
    stage.worlds = worlds;
    stage.newcomers.clear();
    stage.lost.clear();
    stage.beginning.clear();
    stage.is_rebuilding = false;
    Ok(())
}

/// Despawns one world and spawns it again, as its agents have left or others have joined.
pub(crate) fn respawn_world(
    world: &mut World,
    stage: &mut Stage,
    number: usize,
) -> Result<(), GameError> {
    let old = stage.worlds[number];
    let Some(successor) = world.get::<LudusWorld>(old).map(LudusWorld::successor) else {
        return Err(GameError::WorldDespawned(number));
    };
    // The stage is out of the app here, so that observers note neither leavers nor newcomers.
    world.despawn(old);
    let entity = world.spawn(successor).id();
    world.flush();
    stage.worlds[number] = entity;
    let policies = world.resource::<Policies>().clone();
    let rosters = fill_rosters(world, &[entity])?;
    check_rebuilt(stage, &rosters)?;
    for (policy, (own, new)) in stage.rosters.iter_mut().zip(rosters).enumerate() {
        for (offset, agent) in new.agents.into_iter().enumerate() {
            let index = number * own.per_world + offset;
            own.agents[index] = agent;
            own.active[index] = 0;
            if let Some(agent) = agent {
                assign_slot(world, &policies, agent, Slot { policy, index });
            }
        }
    }
    Ok(())
}

/// Checks that worlds have as many slots as before: the spec promises the trainer fixed shapes.
fn check_rebuilt(stage: &Stage, rosters: &[Roster]) -> Result<(), GameError> {
    let mut pairs = rosters.iter().zip(&stage.rosters).enumerate();
    let differing = pairs.find(|(_, (new, old))| new.per_world != old.per_world);
    differing.map_or(Ok(()), |(policy, (new, old))| {
        Err(GameError::Rebuilt {
            policy: stage.spec.policies[policy].name.clone(),
            count: new.per_world,
            expected: old.per_world,
        })
    })
}
