//! The conversation with a trainer, and the worlds that it is about.

use crate::advance::{WorldReset, reset_worlds};
use crate::ceiling::Ceiling;
use crate::isolated::{IsolatedApps, IsolatedWorlds};
use crate::link::{Link, LinkError};
use crate::opening::{Opening, open};
use crate::requests::Requests;
use crate::stage::{Settings, Stage};
use crate::wire::{
    BatchHead, ConnectionState, EngineConfig, ErrorCode, ErrorReport, FLAG_REQUESTS, FrameType,
    ResetAction, Spec, WireError, WorldLayout, encode_json,
};
use bevy_ecs::prelude::*;
use thiserror::Error;

/// Why a conversation ends in the middle.
#[derive(Debug, Error)]
pub(crate) enum Failure {
    #[error("{0}")]
    Link(#[from] LinkError),
    #[error("{0}")]
    Wire(#[from] WireError),
    #[error("{}", .0.message)]
    Told(ErrorReport),
    /// The trainer has said what is wrong.
    #[error("the trainer ended the training: {0}")]
    Trainer(String),
}

impl Failure {
    pub fn new(code: ErrorCode, message: impl Into<String>, hint: &str) -> Self {
        Self::Told(ErrorReport {
            code,
            message: message.into(),
            hint: hint.to_owned(),
        })
    }

    /// Returns what the trainer is told; nothing if it has gone or knows.
    pub fn report(&self) -> Option<ErrorReport> {
        let code = match self {
            Self::Link(LinkError::Wire(_)) => ErrorCode::Frame,
            Self::Link(LinkError::TimedOut(_)) => ErrorCode::Timeout,
            Self::Link(_) | Self::Trainer(_) => return None,
            Self::Wire(WireError::OutOfTurn { .. } | WireError::StepBeforeReset) => {
                ErrorCode::Sequence
            }
            Self::Wire(_) => ErrorCode::Frame,
            Self::Told(report) => return Some(report.clone()),
        };
        Some(ErrorReport {
            code,
            message: self.to_string(),
            hint: String::new(),
        })
    }
}

/// What the next update of the app waits for.
#[derive(Debug)]
pub(crate) enum Pending {
    Nothing,
    /// The answer to a `STEP`.
    Step,
    /// Random play.
    Ceiling(Ceiling),
}

/// Where the worlds live.
pub(crate) enum Host {
    /// In this app.
    Shared,
    /// Each in an app of its own.
    Isolated(Box<IsolatedApps>),
}

/// A trainer, connected.
#[derive(Resource)]
pub(crate) struct Trainer {
    pub link: Link,
    pub state: ConnectionState,
    pub host: Host,
    pub pending: Pending,
    pub ticks_per_step: u32,
    pub num_worlds: usize,
    pub wait_us: u32,
    pub has_requests: bool,
    /// Ticks that there should have been by now.
    pub expected_ticks: u64,
}

impl Trainer {
    /// Makes the worlds that a trainer has asked for.
    pub fn open(
        world: &mut World,
        link: Link,
        state: ConnectionState,
        config: &EngineConfig,
    ) -> Result<Self, Failure> {
        let fail = |message: String| Failure::new(ErrorCode::Config, message, "");
        let settings = world.resource::<Settings>().clone();
        let worlds = world.resource::<IsolatedWorlds>().clone();
        let small =
            |value: Option<u64>| value.map(|value| u32::try_from(value).unwrap_or(u32::MAX));
        let layout = match config.layout {
            WorldLayout::Scene => worlds.layout,
            asked => asked,
        };
        let opening = Opening {
            num_worlds: config.num_worlds as usize,
            first_world: config.first_world,
            layout,
            max_episode_steps: small(config.max_episode_steps),
            ticks_per_step: small(config.ticks_per_step),
        };
        let host = if layout == WorldLayout::Isolated {
            let fill = worlds.fill.ok_or_else(|| {
                let hint = "give LudusPlugin a function with isolated_by(), or use the layout grid";
                let text = "the game cannot make an app for each world";
                Failure::new(ErrorCode::Config, text, hint)
            })?;
            #[cfg_attr(not(feature = "camera"), allow(unused_mut))]
            let mut apps = IsolatedApps::open(fill, &settings, opening).map_err(fail)?;
            #[cfg(feature = "camera")]
            apps.with_world(0, |world| crate::camera::check_renderer(world))
                .unwrap_or(Ok(()))?;
            Host::Isolated(Box::new(apps))
        } else {
            open(world, opening).map_err(fail)?;
            #[cfg(feature = "camera")]
            crate::camera::check_renderer(world)?;
            Host::Shared
        };
        Ok(Self {
            link,
            state,
            host,
            pending: Pending::Nothing,
            ticks_per_step: opening.ticks_per_step.unwrap_or(settings.ticks_per_step),
            num_worlds: opening.num_worlds,
            wait_us: 0,
            has_requests: false,
            expected_ticks: 0,
        })
    }

    pub fn spec<'a>(&'a self, world: &'a World) -> &'a Spec {
        match &self.host {
            Host::Shared => &world.resource::<Stage>().spec,
            Host::Isolated(apps) => &apps.spec,
        }
    }

    /// Sends a frame, and notes it.
    pub fn send(&mut self, kind: FrameType, frame: &[u8]) -> Result<(), Failure> {
        self.state.send(kind)?;
        Ok(self.link.send(frame)?)
    }

    /// Tells the trainer what is wrong, if it can be told.
    pub fn tell(&mut self, report: &ErrorReport) {
        let sent = encode_json(FrameType::Error, report).map(|frame| {
            let _ = self.state.send(FrameType::Error);
            // The trainer may be gone; then nobody is left to be told.
            let _ = self.link.send(&frame);
        });
        debug_assert!(sent.is_ok(), "a report is JSON");
    }

    /// Resets worlds; the batch is the answer.
    pub fn reset(&mut self, world: &mut World, resets: &[WorldReset]) -> Result<(), Failure> {
        let game = |error| Failure::new(ErrorCode::Game, error, "");
        match &mut self.host {
            Host::Shared => {
                reset_worlds(world, resets);
                let error = world.resource_mut::<Stage>().error.take();
                error.map_or(Ok(()), |error| Err(game(error)))
            }
            Host::Isolated(apps) => apps.reset(resets).map_err(game),
        }
    }

    /// Begins new episodes everywhere, with the worlds' own random streams.
    pub fn restart(&mut self, world: &mut World) -> Result<(), Failure> {
        let action = ResetAction::NextEpisode;
        let reset = WorldReset {
            action,
            seed: 0,
            parameters: serde_json::Value::Null,
        };
        self.reset(world, &vec![reset; self.num_worlds])
    }

    /// Begins a step with the actions that are in place. Isolated worlds play it at once.
    pub fn step(&mut self, world: &mut World) -> Result<(), Failure> {
        self.expected_ticks += u64::from(self.ticks_per_step);
        match &mut self.host {
            Host::Shared => {
                let mut stage = world.resource_mut::<Stage>();
                stage.is_stepping = true;
                stage.bridge_time = std::time::Duration::ZERO;
                Ok(())
            }
            Host::Isolated(apps) => {
                let began = std::time::Instant::now();
                let played = apps.step();
                world.resource_mut::<IsolatedClock>().0 = began.elapsed();
                played.map_err(|error| Failure::new(ErrorCode::Game, error, ""))
            }
        }
    }

    /// Takes in the actions of a `STEP` and checks them.
    pub fn take_actions(&mut self, world: &mut World) -> Result<(), WireError> {
        let payload = self.link.payload();
        match &mut self.host {
            Host::Shared => {
                let stage = &mut *world.resource_mut::<Stage>();
                stage.actions.decode(payload)?;
                for (policy, roster) in stage.rosters.iter().enumerate() {
                    let name = &stage.spec.policies[policy].name;
                    stage.actions.check_choices(policy, name, &roster.active)?;
                }
            }
            Host::Isolated(apps) => {
                apps.actions.decode(payload)?;
                for (policy, spec) in apps.spec.policies.iter().enumerate() {
                    let array = apps.batch.layout().policies[policy].active;
                    let active = &apps.batch.bytes()[array.rows(0..spec.num_agents as usize)];
                    apps.actions.check_choices(policy, &spec.name, active)?;
                }
            }
        }
        Ok(())
    }

    /// Checks that the fixed schedule ran as often as it should.
    pub fn check_ticks(&mut self, world: &mut World) -> Result<(), Failure> {
        let ticks = match &mut self.host {
            Host::Shared => world.resource::<Stage>().num_ticks,
            Host::Isolated(apps) => apps.num_ticks(),
        };
        if ticks == self.expected_ticks {
            return Ok(());
        }
        let text = format!("{ticks} ticks have run, expected {}", self.expected_ticks);
        let hint = "neither pause Time<Virtual> in training nor change its speed";
        Err(Failure::new(ErrorCode::Game, text, hint))
    }

    /// Sends the batch.
    pub fn answer(&mut self, world: &mut World, flags: u32) -> Result<(), Failure> {
        let mut requests = world.resource_mut::<Requests>();
        if let Host::Isolated(apps) = &mut self.host {
            apps.take_requests(&mut requests);
        }
        let asks = if self.has_requests && !requests.is_empty() {
            FLAG_REQUESTS
        } else {
            0
        };
        let mut head = BatchHead {
            tick: self.expected_ticks,
            wait_us: self.wait_us,
            flags: flags | asks,
            ..BatchHead::default()
        };
        self.state.send(FrameType::Batch)?;
        match &mut self.host {
            Host::Shared => {
                let stage = &mut *world.resource_mut::<Stage>();
                head.engine_us = stage.game_time.as_micros() as u32;
                head.bridge_us = stage.bridge_time.as_micros() as u32;
                self.link.send(stage.batch.encode(head)?)?;
                stage.batch.shorten();
            }
            Host::Isolated(apps) => {
                head.engine_us = world.resource::<IsolatedClock>().0.as_micros() as u32;
                self.link.send(apps.batch.encode(head)?)?;
                apps.batch.shorten();
            }
        }
        Ok(())
    }

    pub fn set_encoding(&mut self, world: &mut World, is_encoding: bool) {
        match &mut self.host {
            Host::Shared => world.resource_mut::<Stage>().is_encoding = is_encoding,
            Host::Isolated(apps) => apps.set_encoding(is_encoding),
        }
    }
}

/// How long the last step of all isolated worlds took.
#[derive(Resource, Debug, Default)]
pub(crate) struct IsolatedClock(pub std::time::Duration);
