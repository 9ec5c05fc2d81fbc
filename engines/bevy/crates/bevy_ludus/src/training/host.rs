//! Where the worlds of a training live: all in one app, or each in an app of its own.

use super::Failure;
use super::ceiling::Ceiling;
use crate::advance::{WorldReset, reset_worlds};
use crate::error::GameError;
use crate::link::Link;
use crate::methods::{self, CallError};
use crate::requests::Requests;
use crate::stage::Stage;
use crate::wire::{BatchHead, Call, Spec, WireError};
use crate::world::LudusWorld;
use bevy_ecs::prelude::*;
use serde_json::Value;
use std::time::Duration;

/// Is shown each world.
pub(super) type WorldVisitor<'a> = dyn FnMut(Entity, &mut LudusWorld) + 'a;

/// The worlds of a training. Every method is given the world of the app that talks with the trainer.
pub(crate) trait Host: Send + Sync {
    fn spec<'a>(&'a self, world: &'a World) -> &'a Spec;

    /// Resets worlds; the batch is the answer.
    fn reset(&mut self, world: &mut World, resets: &[WorldReset]) -> Result<(), GameError>;

    /// Takes in the actions of a `STEP` and checks them.
    fn take_actions(&mut self, world: &mut World, payload: &[u8]) -> Result<(), WireError>;

    /// Draws the actions of the next step of a measurement. Returns how long all steps took once
    /// they are over.
    fn draw_actions(&mut self, world: &mut World, ceiling: &mut Ceiling) -> Option<Duration>;

    /// Begins a step with the actions that are in place; `decoding` is how long that took. Returns
    /// how many of its ticks are to pass in the app that talks with the trainer.
    fn step(&mut self, world: &mut World, ticks: u32, decoding: Duration)
    -> Result<u32, GameError>;

    /// Returns how many ticks every world has had.
    fn num_ticks(&mut self, world: &World) -> u64;

    /// Sends the batch, with the times of the last step in its head.
    fn send_batch(
        &mut self,
        world: &mut World,
        head: BatchHead,
        link: &mut Link,
    ) -> Result<(), Failure>;

    /// Sets whether observations go into the batch; not so while the ceiling is measured.
    fn set_encoding(&mut self, world: &mut World, is_encoding: bool);

    /// Visits all worlds.
    fn for_each_world(&mut self, world: &mut World, visit: &mut WorldVisitor<'_>);

    /// Lets worlds in apps of their own ask things of the trainer.
    fn open_requests(&mut self) {}

    /// Takes over what worlds in apps of their own ask of the trainer.
    fn take_requests(&mut self, _requests: &mut Requests) {}

    /// Calls a method of the game in one of the worlds.
    fn call(&mut self, world: &mut World, call: &Call, number: usize) -> Result<Value, CallError>;
}

/// Visits the worlds of one app. The game does not see that as a change.
pub(super) fn visit_worlds(app: &mut World, visit: &mut WorldVisitor<'_>) {
    for entity in app.resource::<Stage>().worlds.clone() {
        if let Some(mut world) = app.get_mut::<LudusWorld>(entity) {
            visit(entity, world.bypass_change_detection());
        }
    }
}

/// All worlds in the app that talks with the trainer: the layout grid.
pub(super) struct GridHost;

impl Host for GridHost {
    fn spec<'a>(&'a self, world: &'a World) -> &'a Spec {
        &world.resource::<Stage>().spec
    }

    fn reset(&mut self, world: &mut World, resets: &[WorldReset]) -> Result<(), GameError> {
        reset_worlds(world, resets);
        let error = world.resource_mut::<Stage>().error.take();
        error.map_or(Ok(()), Err)
    }

    fn take_actions(&mut self, world: &mut World, payload: &[u8]) -> Result<(), WireError> {
        let stage = &mut *world.resource_mut::<Stage>();
        stage.actions.decode(payload)?;
        for (policy, roster) in stage.rosters.iter().enumerate() {
            let name = &stage.spec.policies[policy].name;
            stage.actions.check_choices(policy, name, &roster.active)?;
        }
        Ok(())
    }

    fn draw_actions(&mut self, world: &mut World, ceiling: &mut Ceiling) -> Option<Duration> {
        let stage = &mut *world.resource_mut::<Stage>();
        ceiling.advance(&stage.spec, &mut stage.actions)
    }

    fn step(
        &mut self,
        world: &mut World,
        ticks: u32,
        decoding: Duration,
    ) -> Result<u32, GameError> {
        let mut stage = world.resource_mut::<Stage>();
        stage.is_stepping = true;
        stage.bridge_time = decoding;
        Ok(ticks)
    }

    fn num_ticks(&mut self, world: &World) -> u64 {
        world.resource::<Stage>().num_ticks
    }

    fn send_batch(
        &mut self,
        world: &mut World,
        mut head: BatchHead,
        link: &mut Link,
    ) -> Result<(), Failure> {
        let stage = &mut *world.resource_mut::<Stage>();
        head.engine_us = stage.game_time.as_micros() as u32;
        head.bridge_us = stage.bridge_time.as_micros() as u32;
        link.send(stage.batch.encode(head)?)?;
        stage.batch.shorten();
        Ok(())
    }

    fn set_encoding(&mut self, world: &mut World, is_encoding: bool) {
        world.resource_mut::<Stage>().is_encoding = is_encoding;
    }

    fn for_each_world(&mut self, world: &mut World, visit: &mut WorldVisitor<'_>) {
        visit_worlds(world, visit);
    }

    fn call(&mut self, world: &mut World, call: &Call, number: usize) -> Result<Value, CallError> {
        methods::call(world, call, number)
    }
}
