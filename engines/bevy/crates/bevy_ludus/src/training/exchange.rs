//! The system in which the app waits for the trainer.

use crate::advance::{WorldReset, enter};
use crate::ceiling::Ceiling;
use crate::link::{CommandLine, LinkError, PendingLink, connect, greet};
use crate::methods;
use crate::pace::Pace;
use crate::play;
use crate::requests::{Requests, TrainingStatus};
use crate::schedules::ControlState;
use crate::stage::Stage;
use crate::trainer::{Failure, Host, IsolatedClock, Pending, Trainer};
use crate::wire::{
    Call, CallResult, ErrorCode, ErrorReport, FLAG_RESET, FrameType, ResetAction, ResetRequest,
    WireError, encode_frame, encode_json, read_object,
};
use bevy_app::AppExit;
use bevy_ecs::prelude::*;
use bevy_state::prelude::*;
use bevy_time::{Fixed, Real, Time, TimeUpdateStrategy, Virtual};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// How the update of the app goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// So many ticks pass.
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
            trainer.tell(&report);
        }
        next
    });
    match next {
        Ok(Next::Ticks(ticks)) => let_pass(world, ticks),
        Ok(Next::End) => quit(world, AppExit::Success),
        Err(failure) => {
            complain(&failure);
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
        meet(world, &arguments)
    } else {
        play::start(world, &arguments)
    };
    if let Err(failure) = started {
        complain(&failure);
        quit(world, AppExit::error());
    }
}

fn meet(world: &mut World, arguments: &CommandLine) -> Result<(), Failure> {
    let mut link = connect(arguments)?;
    let (state, welcome) = match greet(&mut link, arguments) {
        Ok(greeted) => greeted,
        Err(failure) => {
            farewell(&mut link, &failure);
            return Err(failure);
        }
    };
    link.watch_parent(arguments.parent_pid);
    link.set_pace(&welcome.config);
    let mut teller = link.try_clone()?;
    let mut trainer =
        Trainer::open(world, link, state, &welcome.config).inspect_err(|failure| {
            farewell(&mut teller, failure);
        })?;
    trainer.has_requests = welcome.capabilities.iter().any(|name| name == "requests");
    if trainer.has_requests {
        world.resource_mut::<Requests>().open();
        if let Host::Isolated(apps) = &mut trainer.host {
            apps.open_requests();
        }
    }
    let frame = encode_json(FrameType::Spec, trainer.spec(world))?;
    trainer.send(FrameType::Spec, &frame)?;
    // However many ticks a step has, none is dropped; nor those of the first update, in which
    // Bevy's clock only takes the time.
    world
        .resource_mut::<Time<Virtual>>()
        .set_max_delta(Duration::MAX);
    world
        .resource_mut::<Time<Real>>()
        .update_with_duration(Duration::ZERO);
    world.init_resource::<IsolatedClock>();
    if arguments.is_real_time {
        let timestep = world.resource::<Time<Fixed>>().timestep();
        world.insert_resource(Pace::new(timestep * trainer.ticks_per_step));
    }
    world.insert_resource(trainer);
    Ok(())
}

fn farewell(link: &mut crate::link::Link, failure: &Failure) {
    if let Some(frame) = failure
        .report()
        .and_then(|it| encode_json(FrameType::Error, &it).ok())
    {
        // The trainer may be gone; then nobody is left to be told.
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
        return Err(Failure::new(ErrorCode::Game, error, ""));
    }
    trainer.check_ticks(world)?;
    match std::mem::replace(&mut trainer.pending, Pending::Nothing) {
        Pending::Ceiling(ceiling) => go_on(world, trainer, ceiling),
        _ => trainer.answer(world, 0).map(|()| None),
    }
}

fn take_step(world: &mut World, trainer: &mut Trainer) -> Result<Next, Failure> {
    let began = Instant::now();
    trainer.take_actions(world)?;
    let decoding = began.elapsed();
    trainer.step(world)?;
    if let Some(mut stage) = world.get_resource_mut::<Stage>() {
        stage.bridge_time += decoding;
    }
    trainer.pending = Pending::Step;
    Ok(Next::Ticks(shared_ticks(trainer)))
}

/// Ticks that pass in this app; worlds in apps of their own have had theirs.
fn shared_ticks(trainer: &Trainer) -> u32 {
    if matches!(trainer.host, Host::Shared) {
        trainer.ticks_per_step
    } else {
        0
    }
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
    trainer.reset(world, &resets)?;
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
        trainer.set_encoding(world, false);
        trainer.state.require_reset();
        return go_on(world, trainer, Ceiling::new(call.id, num_steps, seed));
    }
    let outcome = if call.is_for_bridge() {
        call_bridge(world, &call)
    } else {
        call_game(world, trainer, &call)
    };
    let frame = encode_json(FrameType::Result, &CallResult::of(&call, outcome))?;
    trainer.send(FrameType::Result, &frame)?;
    Ok(None)
}

/// Plays the next step of a measurement, or tells how long all took.
fn go_on(
    world: &mut World,
    trainer: &mut Trainer,
    mut ceiling: Ceiling,
) -> Result<Option<Next>, Failure> {
    let elapsed = match &mut trainer.host {
        Host::Shared => {
            let stage = &mut *world.resource_mut::<Stage>();
            ceiling.advance(&stage.spec, &mut stage.actions)
        }
        Host::Isolated(apps) => ceiling.advance(&apps.spec, &mut apps.actions),
    };
    if let Some(elapsed) = elapsed {
        trainer.set_encoding(world, true);
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
    trainer.step(world)?;
    trainer.pending = Pending::Ceiling(ceiling);
    Ok(Some(Next::Ticks(shared_ticks(trainer))))
}

fn call_bridge(world: &mut World, call: &Call) -> Result<Value, String> {
    match call.method.as_str() {
        "take_requests" => Ok(Value::Array(world.resource_mut::<Requests>().take())),
        "show_status" => {
            let status = call.arguments.first().cloned().unwrap_or(Value::Null);
            let status: TrainingStatus = serde_json::from_value(status)
                .map_err(|error| format!("show_status takes one object: {error}"))?;
            world.write_message(status);
            Ok(Value::Null)
        }
        method => Err(format!("the add-on has no method {method}")),
    }
}

fn call_game(world: &mut World, trainer: &mut Trainer, call: &Call) -> Result<Value, String> {
    let number = call.world().ok_or("a call names a world, or the bridge")?;
    match &mut trainer.host {
        Host::Shared => methods::call(world, call, number),
        Host::Isolated(apps) => apps
            .with_world(number, |world| methods::call(world, call, 0))
            .unwrap_or_else(|| Err(format!("there is no world {number}"))),
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
    world.insert_resource(TimeUpdateStrategy::FixedTimesteps(0));
    world.write_message(exit);
}

/// The last words of a game that fails, for whoever reads its output.
#[allow(clippy::print_stderr)]
fn complain(failure: &Failure) {
    eprintln!("ludus: {failure}");
    if let Failure::Told(report) = failure
        && !report.hint.is_empty()
    {
        eprintln!("hint: {}", report.hint);
    }
}
