//! Which agent has which slot.

use crate::components::{Agent, Slot};
use crate::error::GameError;
use crate::policy::Policies;
use crate::wire::{AgentSpec, PolicySpec};
use crate::world::{InWorld, WorldMembers};
use bevy_ecs::prelude::*;

/// The agents of one policy by slot.
#[derive(Clone, Debug, Default)]
pub(crate) struct Roster {
    /// The agent in each slot; none in a free slot.
    pub agents: Vec<Option<Entity>>,
    /// Which slots act on the observation that is sent next, 1 or 0.
    pub active: Vec<u8>,
    /// Slots in each world.
    pub per_world: usize,
    /// How many of them are kept free.
    pub num_spare: usize,
    /// Steps after which an episode is cut off.
    pub max_steps: u32,
}

impl Roster {
    /// Describes the slots for the handshake.
    pub fn describe(&self, world: &World, first_world: usize, spec: &mut PolicySpec) {
        spec.num_agents = self.agents.len() as u64;
        spec.agents_per_world = self.per_world as u64;
        spec.agents = (0..self.agents.len())
            .map(|slot| AgentSpec {
                world: (first_world + slot / self.per_world) as u64,
                path: self.agents[slot].map(|agent| self.path_of(world, agent, slot)),
            })
            .collect();
    }

    fn path_of(&self, world: &World, agent: Entity, slot: usize) -> String {
        if let Some(name) = world.get::<Name>(agent) {
            return name.to_string();
        }
        let policy = world
            .get::<Agent>(agent)
            .map_or("", |agent| agent.policy.as_str());
        if self.per_world == 1 {
            policy.to_owned()
        } else {
            format!("{policy} {slot}")
        }
    }

    /// Says where a slot is, for messages.
    pub fn place(&self, policy: &str, slot: usize) -> String {
        format!(
            "policy {policy}, world {}, slot {slot}",
            slot / self.per_world
        )
    }
}

/// Finds the agents of some worlds, gives them their slots and their components.
///
/// Agents come in the order in which they joined their world.
pub(crate) fn fill_rosters(world: &mut World, worlds: &[Entity]) -> Result<Vec<Roster>, GameError> {
    check_all_have_worlds(world)?;
    let policies = world.get_resource_or_init::<Policies>().clone();
    let mut rosters = vec![Roster::default(); policies.entries.len()];
    for (number, entity) in worlds.iter().enumerate() {
        let members = members_of(world, &policies, *entity)?;
        for (policy, agents) in members.into_iter().enumerate() {
            let roster = &mut rosters[policy];
            let spare = policies.entries[policy].policy.spare_slots;
            let count = agents.len() + spare;
            if number == 0 {
                (roster.per_world, roster.num_spare) = (count, spare);
            } else if roster.per_world != count {
                return Err(GameError::UnequalWorlds {
                    world: number,
                    policy: policies.entries[policy].policy.name.clone(),
                    count,
                    expected: roster.per_world,
                });
            }
            roster.agents.extend(agents.into_iter().map(Some));
            roster.agents.resize((number + 1) * count, None);
        }
    }
    for (policy, roster) in rosters.iter_mut().enumerate() {
        let entry = &policies.entries[policy];
        if roster.agents.is_empty() {
            return Err(GameError::NoAgent(entry.policy.name.clone()));
        }
        roster.active = vec![0; roster.agents.len()];
        roster.max_steps = entry.policy.max_episode_steps.unwrap_or(u32::MAX);
        for index in 0..roster.agents.len() {
            if let Some(agent) = roster.agents[index] {
                assign_slot(world, &policies, agent, Slot { policy, index });
            }
        }
    }
    Ok(rosters)
}

/// Gives an agent its slot and the components it lacks.
pub(crate) fn assign_slot(world: &mut World, policies: &Policies, agent: Entity, slot: Slot) {
    if let Ok(mut entity) = world.get_entity_mut(agent) {
        policies.entries[slot.policy].insert_missing(&mut entity);
        entity.insert(slot);
    }
}

fn members_of(
    world: &World,
    policies: &Policies,
    entity: Entity,
) -> Result<Vec<Vec<Entity>>, GameError> {
    let mut found = vec![Vec::new(); policies.entries.len()];
    let Some(members) = world.get::<WorldMembers>(entity) else {
        return Ok(found);
    };
    for member in members.iter() {
        if let Some(agent) = world.get::<Agent>(member) {
            let policy = policies.find(&agent.policy);
            found[policy.ok_or_else(|| unknown(policies, &agent.policy))?].push(member);
        }
    }
    Ok(found)
}

fn check_all_have_worlds(world: &mut World) -> Result<(), GameError> {
    let mut strays = world.query_filtered::<&Agent, Without<InWorld>>();
    match strays.iter(world).next() {
        None => Ok(()),
        Some(agent) => Err(GameError::AgentWithoutWorld(agent.policy.clone())),
    }
}

fn unknown(policies: &Policies, name: &str) -> GameError {
    let names = policies.entries.iter();
    let names: Vec<_> = names.map(|entry| entry.policy.name.as_str()).collect();
    GameError::UnknownPolicy {
        name: name.to_owned(),
        known: names.join(", "),
    }
}
