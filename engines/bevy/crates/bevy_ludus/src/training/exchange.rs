//! The system in which the app waits for the trainer.

use super::ceiling::Ceiling;
use super::pace::Pace;
use super::{Failure, Pending, Trainer};
use crate::advance::{WorldReset, enter};
use crate::error::{end_with_error, print_error};
use crate::link::{CommandLine, LinkError, PendingLink, connect, greet};
use crate::methods::CallError;
use crate::play;
use crate::policy_plugin::PolicySources;
use crate::requests::{Requests, TrainingStatus};
use crate::schedules::ControlState;
use crate::stage::Stage;
use crate::wire::{
    Call, CallResult, ErrorReport, FLAG_RESET, FrameType, ResetAction, ResetRequest, WireError,
    encode_frame, encode_json, read_object,
};
use bevy_app::AppExit;
use bevy_ecs::prelude::*;
use bevy_state::prelude::*;
use bevy_time::{Fixed, Real, Time, TimeUpdateStrategy, Virtual};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// What the update of the app does after the exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// This number of ticks pass.
    Ticks(u32),
    /// The trainer has gone.
    End,
}

/// Sends the answer to the last request and waits for the next one that lets time pass.
pub(crate) fn exchange(world: &mut World, mut has_started: Local<bool>) {
    if !std::mem::replace(&mut *has_started, true) {
        start(world);
    }
    if !world.contains_resource::<Trainer>() {
        return;
    }
    enter(world, ControlState::PausedForControl);
    let next = world.resource_scope(|world, mut trainer: Mut<Trainer>| {
        let next = serve(world, &mut trainer);
        if let Err(failure) = &next
            && let Some(report) = failure.report()
        {
            trainer.report_error(&report);
        }
        next
    });
    match next {
        Ok(Next::Ticks(ticks)) => let_pass(world, ticks),
        Ok(Next::End) => quit(world, AppExit::Success),
        Err(failure) => {
            print_error(&failure, failure.hint());
            quit(world, AppExit::error());
        }
    }
}

/// Connects, greets and makes the worlds; without a trainer, plays.
fn start(world: &mut World) {
    let arguments = world
        .remove_resource::<PendingLink>()
        .map(|pending| pending.0);
    let arguments = arguments.unwrap_or_default();
    let started = if arguments.has_trainer() {
        connect_and_open(world, &arguments)
    } else {
        let mut sources = world.remove_resource::<PolicySources>().unwrap_or_default();
        sources.overlay(&arguments);
        play::start(world, &sources).map_err(Failure::Opening)
    };
    if let Err(failure) = started {
        end_with_error(world, &failure, failure.hint());
        stop_clock(world);
    }
}

fn connect_and_open(world: &mut World, arguments: &CommandLine) -> Result<(), Failure> {
    let mut link = connect(arguments)?;
    let (state, welcome) = match greet(&mut link, arguments) {
        Ok(greeted) => greeted,
        Err(failure) => {
            report_failure(&mut link, &failure);
            return Err(failure);
        }
    };
    link.set_pace(&welcome.config);
    // The trainer takes the link; an error in opening it has to reach the other side all the same.
    let mut reporter = link.try_clone()?;
    let mut trainer =
        Trainer::open(world, link, state, &welcome.config).inspect_err(|failure| {
            report_failure(&mut reporter, failure);
        })?;
    trainer.has_requests = welcome.capabilities.iter().any(|name| name == "requests");
    if trainer.has_requests {
        world.resource_mut::<Requests>().open();
        trainer.host.open_requests();
    }
    if welcome.capabilities.iter().any(|name| name == "metrics") {
        trainer.open_metrics(world);
    }
    let frame = encode_json(FrameType::Spec, trainer.host.spec(world))?;
    trainer.send(FrameType::Spec, &frame)?;
    // However many ticks a step has, none is dropped; nor those of the first update, in which
    // Bevy's clock only takes the time.
    world
        .resource_mut::<Time<Virtual>>()
        .set_max_delta(Duration::MAX);
    world
        .resource_mut::<Time<Real>>()
        .update_with_duration(Duration::ZERO);
    if arguments.is_real_time {
        let timestep = world.resource::<Time<Fixed>>().timestep();
        world.insert_resource(Pace::new(timestep * trainer.ticks_per_step));
    }
    world.insert_resource(trainer);
    Ok(())
}

fn report_failure(link: &mut crate::link::Link, failure: &Failure) {
    if let Some(frame) = failure
        .report()
        .and_then(|it| encode_json(FrameType::Error, &it).ok())
    {
        // An error means that the trainer has gone, and needs no report.
        let _ = link.send(&frame);
    }
}

fn serve(world: &mut World, trainer: &mut Trainer) -> Result<Next, Failure> {
    if let Some(next) = finish_pending(world, trainer)? {
        return Ok(next);
    }
    loop {
        let asked = Instant::now();
        let kind = match trainer.link.receive() {
            Err(LinkError::Closed) => return Ok(Next::End),
            received => received?,
        };
        trainer.wait_us = asked.elapsed().as_micros() as u32;
        trainer.state.receive(kind)?;
        let next = match kind {
            FrameType::Step => Some(take_step(world, trainer)?),
            FrameType::Reset => take_reset(world, trainer)?,
            FrameType::Call => take_call(world, trainer)?,
            FrameType::Ping => {
                let frame = encode_frame(FrameType::Pong, trainer.link.payload())?;
                trainer.send(FrameType::Pong, &frame)?;
                None
            }
            FrameType::Error => {
                let report: ErrorReport = read_object(trainer.link.payload(), "ERROR")?;
                return Err(Failure::Trainer(report.message));
            }
            _ => Some(Next::End),
        };
        if let Some(next) = next {
            return Ok(next);
        }
    }
}

/// Answers what has been played since the last exchange.
fn finish_pending(world: &mut World, trainer: &mut Trainer) -> Result<Option<Next>, Failure> {
    if matches!(trainer.pending, Pending::Nothing) {
        return Ok(None);
    }
    let error = world
        .get_resource_mut::<Stage>()
        .and_then(|mut stage| stage.error.take());
    if let Some(error) = error {
        return Err(error.into());
    }
    trainer.check_ticks(world)?;
    match std::mem::replace(&mut trainer.pending, Pending::Nothing) {
        Pending::Ceiling(ceiling) => go_on(world, trainer, ceiling),
        _ => trainer.answer(world, 0).map(|()| None),
    }
}

fn take_step(world: &mut World, trainer: &mut Trainer) -> Result<Next, Failure> {
    let began = Instant::now();
    trainer.host.take_actions(world, trainer.link.payload())?;
    let ticks = trainer.step(world, began.elapsed())?;
    trainer.pending = Pending::Step;
    Ok(Next::Ticks(ticks))
}

fn take_reset(world: &mut World, trainer: &mut Trainer) -> Result<Option<Next>, Failure> {
    let request = ResetRequest::decode(trainer.link.payload())?;
    if request.seeds.len() != trainer.num_worlds {
        let (bytes, expected) = (request.seeds.len(), trainer.num_worlds);
        return Err(WireError::Size {
            what: "RESET.num_worlds",
            bytes,
            expected,
        }
        .into());
    }
    let resets: Vec<_> = (0..trainer.num_worlds)
        .map(|number| WorldReset {
            action: request.actions[number],
            seed: request.seeds[number],
            parameters: match request.actions[number] {
                ResetAction::Leave => Value::Null,
                _ => request.parameters_of(number).clone(),
            },
        })
        .collect();
    trainer.host.reset(world, &resets)?;
    trainer.answer(world, FLAG_RESET)?;
    enter(world, ControlState::PausedForControl);
    Ok(None)
}

fn take_call(world: &mut World, trainer: &mut Trainer) -> Result<Option<Next>, Failure> {
    let call: Call = read_object(trainer.link.payload(), "CALL")?;
    if call.is_for_bridge() && call.method == "run_ceiling" {
        let seed = call.whole_argument(1).unwrap_or(0);
        let num_steps = call.whole_argument(0).unwrap_or(1);
        trainer.restart(world)?;
        trainer.host.set_encoding(world, false);
        trainer.state.require_reset();
        return go_on(world, trainer, Ceiling::new(call.id, num_steps, seed));
    }
    let outcome = if call.is_for_bridge() && call.method == "take_requests" {
        let mut requests = world.resource_mut::<Requests>().take();
        requests.extend(trainer.take_metrics(world)?);
        Ok(Value::Array(requests))
    } else if call.is_for_bridge() {
        call_bridge(world, &call)
    } else if let Some(number) = call.world() {
        trainer.host.call(world, &call, number)
    } else {
        Err(CallError::NoTarget)
    };
    let result = CallResult::of(&call, outcome.map_err(|error| error.to_string()));
    let frame = encode_json(FrameType::Result, &result)?;
    trainer.send(FrameType::Result, &frame)?;
    Ok(None)
}

/// Plays the next step of a measurement, or tells how long all took.
fn go_on(
    world: &mut World,
    trainer: &mut Trainer,
    mut ceiling: Ceiling,
) -> Result<Option<Next>, Failure> {
    let elapsed = trainer.host.draw_actions(world, &mut ceiling);
    if let Some(elapsed) = elapsed {
        trainer.host.set_encoding(world, true);
        let value = json!({
            "elapsed_us": elapsed.as_micros() as u64, "num_steps": ceiling.num_steps
        });
        let frame = encode_json(
            FrameType::Result,
            &json!({"id": ceiling.id, "value": value}),
        )?;
        trainer.send(FrameType::Result, &frame)?;
        return Ok(None);
    }
    let ticks = trainer.step(world, Duration::ZERO)?;
    trainer.pending = Pending::Ceiling(ceiling);
    Ok(Some(Next::Ticks(ticks)))
}

fn call_bridge(world: &mut World, call: &Call) -> Result<Value, CallError> {
    match call.method.as_str() {
        "show_status" => {
            let status = call.arguments.first().cloned().unwrap_or(Value::Null);
            world.write_message(serde_json::from_value::<TrainingStatus>(status)?);
            Ok(Value::Null)
        }
        method => Err(CallError::NoBridgeMethod(method.to_owned())),
    }
}

/// Lets ticks pass in this update of the app, however much time passes for people.
fn let_pass(world: &mut World, ticks: u32) {
    world.insert_resource(TimeUpdateStrategy::FixedTimesteps(ticks));
    world
        .resource_mut::<NextState<ControlState>>()
        .set(ControlState::Running);
}

fn quit(world: &mut World, exit: AppExit) {
    world.remove_resource::<Trainer>();
    world.write_message(exit);
    stop_clock(world);
}

/// Lets no tick pass in the update that is the app's last.
fn stop_clock(world: &mut World) {
    world.insert_resource(TimeUpdateStrategy::FixedTimesteps(0));
}
