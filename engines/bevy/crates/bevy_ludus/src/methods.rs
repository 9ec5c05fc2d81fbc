//! Methods of the game that the trainer may call (PROTOCOL.md §8).

#[cfg(feature = "trainer")]
use crate::stage::Stage;
#[cfg(feature = "trainer")]
use crate::wire::Call;
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemId;
use serde_json::Value;
use std::collections::HashMap;

/// What a method is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Arguments {
    /// The world that is called, or in which the agent is.
    pub world: Entity,
    /// The agent that is called, if any.
    pub agent: Option<Entity>,
    /// The arguments.
    pub values: Vec<Value>,
}

/// What a method returns: any JSON value, or why it failed.
pub type MethodResult = Result<Value, String>;

/// The methods of an app by name.
#[derive(Resource, Default)]
pub(crate) struct Methods {
    pub systems: HashMap<String, SystemId<In<Arguments>, MethodResult>>,
}

/// Calls a method of a world that lives in this app. `number` is its index here.
#[cfg(feature = "trainer")]
pub(crate) fn call(world: &mut World, call: &Call, number: usize) -> MethodResult {
    let stage = world
        .get_resource::<Stage>()
        .ok_or("there are no worlds yet")?;
    let entity = *stage
        .worlds
        .get(number)
        .ok_or_else(|| format!("there is no world {number}"))?;
    let agent = match call.agent() {
        Some(path) => Some(find_agent(stage, number, path)?),
        None => None,
    };
    let system = world
        .get_resource::<Methods>()
        .and_then(|all| all.systems.get(&call.method));
    let system = *system.ok_or_else(|| format!("the game has no method {}", call.method))?;
    let arguments = Arguments {
        world: entity,
        agent,
        values: call.arguments.clone(),
    };
    world
        .run_system_with(system, arguments)
        .map_err(|error| error.to_string())?
}

#[cfg(feature = "trainer")]
fn find_agent(stage: &Stage, number: usize, path: &str) -> Result<Entity, String> {
    let find = |slot: &crate::components::Slot| {
        let spec = &stage.spec.policies[slot.policy].agents[slot.index];
        let is_it = spec.path.as_deref() == Some(path);
        stage.rosters[slot.policy].agents[slot.index].filter(|_| is_it)
    };
    let slots = stage.slots_of(number);
    let found = slots.iter().find_map(find);
    found.ok_or_else(|| format!("there is no agent {path} in world {number}"))
}
