//! Methods of the game that the trainer may call (PROTOCOL.md §8).

#[cfg(feature = "trainer")]
use crate::stage::Stage;
#[cfg(feature = "trainer")]
use crate::wire::Call;
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemId;
use serde_json::Value;
use std::collections::HashMap;
#[cfg(feature = "trainer")]
use thiserror::Error;

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

/// What a method returns: any JSON value, or why it failed, in the game's own words.
pub type MethodResult = Result<Value, String>;

/// Why a call of the trainer fails. It ends neither the game nor the training.
#[cfg(feature = "trainer")]
#[derive(Debug, Error)]
pub(crate) enum CallError {
    #[error("a call names a world, or the bridge")]
    NoTarget,
    #[error("there is no world {0}")]
    NoWorld(usize),
    #[error("there is no agent {path} in world {world}")]
    NoAgent { world: usize, path: String },
    #[error("the game has no method {0}")]
    NoMethod(String),
    #[error("the add-on has no method {0}")]
    NoBridgeMethod(String),
    #[error("show_status takes one object: {0}")]
    Status(#[from] serde_json::Error),
    /// The method ran, and reports an error.
    #[error("{0}")]
    Method(String),
}

/// The methods of an app by name.
#[derive(Resource, Default)]
pub(crate) struct Methods {
    pub systems: HashMap<String, SystemId<In<Arguments>, MethodResult>>,
}

/// Calls a method of a world that lives in this app. `number` is its index here, which is not the one
/// that the call names where each world has its own app.
#[cfg(feature = "trainer")]
pub(crate) fn call(world: &mut World, call: &Call, number: usize) -> Result<Value, CallError> {
    let named = call.world().unwrap_or(number);
    let stage = world.get_resource::<Stage>();
    let Some((stage, entity)) = stage.and_then(|it| Some((it, *it.worlds.get(number)?))) else {
        return Err(CallError::NoWorld(named));
    };
    let agent = match call.agent() {
        Some(path) => Some(find_agent(stage, number, path).ok_or_else(|| {
            let path = path.to_owned();
            CallError::NoAgent { world: named, path }
        })?),
        None => None,
    };
    let system = world
        .get_resource::<Methods>()
        .and_then(|all| all.systems.get(&call.method));
    let system = *system.ok_or_else(|| CallError::NoMethod(call.method.clone()))?;
    let arguments = Arguments {
        world: entity,
        agent,
        values: call.arguments.clone(),
    };
    world
        .run_system_with(system, arguments)
        .map_err(|error| CallError::Method(error.to_string()))?
        .map_err(CallError::Method)
}

#[cfg(feature = "trainer")]
fn find_agent(stage: &Stage, number: usize, path: &str) -> Option<Entity> {
    stage.slots_of(number).iter().find_map(|slot| {
        let spec = &stage.spec.policies[slot.policy].agents[slot.index];
        let is_it = spec.path.as_deref() == Some(path);
        stage.rosters[slot.policy].agents[slot.index].filter(|_| is_it)
    })
}
