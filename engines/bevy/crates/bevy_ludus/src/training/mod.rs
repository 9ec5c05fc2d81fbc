//! The conversation with a trainer, by the feature `trainer`, and the worlds that it is about.

mod ceiling;
mod exchange;
mod host;
mod isolated;
mod isolated_frames;
mod pace;

pub(crate) use exchange::exchange;
pub(crate) use isolated::IsolatedWorlds;
pub(crate) use pace::{Pace, keep_pace};

use crate::advance::WorldReset;
use crate::error::GameError;
use crate::link::{Link, LinkError};
use crate::metrics::Summaries;
use crate::opening::{Opening, open};
use crate::requests::Requests;
use crate::stage::Settings;
use crate::wire::{
    BatchHead, ConnectionState, EngineConfig, ErrorCode, ErrorReport, FLAG_REQUESTS, FrameType,
    ResetAction, WireError, WorldLayout, encode_json,
};
use bevy_ecs::prelude::*;
use ceiling::Ceiling;
use host::{GridHost, Host};
use isolated::IsolatedApps;
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use thiserror::Error;

/// Why a conversation ends in the middle.
#[derive(Debug, Error)]
pub(crate) enum Failure {
    #[error("{0}")]
    Link(#[from] LinkError),
    #[error("{0}")]
    Wire(#[from] WireError),
    /// The handshake is refused.
    #[error("{}", .0.message)]
    Refused(ErrorReport),
    /// The worlds that the trainer asks for cannot be made.
    #[error("{0}")]
    Opening(GameError),
    /// The game made a mistake while it played.
    #[error("{0}")]
    Game(#[from] GameError),
    /// The trainer has said what is wrong.
    #[error("the trainer ended the training: {0}")]
    Trainer(String),
}

impl Failure {
    pub fn new(code: ErrorCode, message: impl Into<String>, hint: &str) -> Self {
        Self::Refused(ErrorReport {
            code,
            message: message.into(),
            hint: hint.to_owned(),
        })
    }

    /// Returns what to do about it; empty where nothing is known.
    pub fn hint(&self) -> &str {
        match self {
            Self::Refused(report) => &report.hint,
            Self::Opening(error) | Self::Game(error) => error.hint(),
            Self::Link(_) | Self::Wire(_) | Self::Trainer(_) => "",
        }
    }

    /// Returns the report for the trainer; none if it has gone, or reported the error itself.
    pub fn report(&self) -> Option<ErrorReport> {
        let code = match self {
            Self::Link(LinkError::Wire(_)) => ErrorCode::Frame,
            Self::Link(LinkError::TimedOut(_)) => ErrorCode::Timeout,
            Self::Link(_) | Self::Trainer(_) => return None,
            Self::Wire(WireError::OutOfTurn { .. } | WireError::StepBeforeReset) => {
                ErrorCode::Sequence
            }
            Self::Wire(_) => ErrorCode::Frame,
            Self::Refused(report) => return Some(report.clone()),
            Self::Opening(error) => code_of_opening(error),
            Self::Game(_) => ErrorCode::Game,
        };
        Some(ErrorReport {
            code,
            message: self.to_string(),
            hint: self.hint().to_owned(),
        })
    }
}

fn code_of_opening(error: &GameError) -> ErrorCode {
    match error {
        #[cfg(feature = "camera")]
        GameError::Picture(crate::camera::PictureError::NoRenderer) => ErrorCode::Renderer,
        _ => ErrorCode::Config,
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

/// A trainer, connected.
#[derive(Resource)]
pub(crate) struct Trainer {
    pub link: Link,
    pub state: ConnectionState,
    pub host: Box<dyn Host>,
    pub pending: Pending,
    pub ticks_per_step: u32,
    pub num_worlds: usize,
    pub wait_us: u32,
    pub has_requests: bool,
    /// Whether a metric that a world has reported cannot be taken.
    pub is_metric_refused: Arc<AtomicBool>,
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
        let host = make_host(world, worlds, &settings, opening).map_err(Failure::Opening)?;
        Ok(Self {
            link,
            state,
            host,
            pending: Pending::Nothing,
            ticks_per_step: opening.ticks_per_step.unwrap_or(settings.ticks_per_step),
            num_worlds: opening.num_worlds,
            wait_us: 0,
            has_requests: false,
            is_metric_refused: Arc::default(),
            expected_ticks: 0,
        })
    }

    /// Sends a frame, and notes it.
    pub fn send(&mut self, kind: FrameType, frame: &[u8]) -> Result<(), Failure> {
        self.state.send(kind)?;
        Ok(self.link.send(frame)?)
    }

    /// Tells the trainer what is wrong, if it can be told.
    pub fn report_error(&mut self, report: &ErrorReport) {
        let sent = encode_json(FrameType::Error, report).map(|frame| {
            let _ = self.state.send(FrameType::Error);
            // An error means that the trainer has gone, and needs no report.
            let _ = self.link.send(&frame);
        });
        debug_assert!(sent.is_ok(), "a report is JSON");
    }

    /// Begins new episodes everywhere, with the worlds' own random streams.
    pub fn restart(&mut self, world: &mut World) -> Result<(), Failure> {
        let action = ResetAction::NextEpisode;
        let reset = WorldReset {
            action,
            seed: 0,
            parameters: serde_json::Value::Null,
        };
        Ok(self.host.reset(world, &vec![reset; self.num_worlds])?)
    }

    /// Begins a step with the actions that are in place. Returns the ticks that this app is to pass.
    pub fn step(&mut self, world: &mut World, decoding: Duration) -> Result<u32, Failure> {
        self.expected_ticks += u64::from(self.ticks_per_step);
        Ok(self.host.step(world, self.ticks_per_step, decoding)?)
    }

    /// Checks that the fixed schedule ran as often as it should.
    pub fn check_ticks(&mut self, world: &World) -> Result<(), GameError> {
        let (ran, expected) = (self.host.num_ticks(world), self.expected_ticks);
        if ran == expected {
            Ok(())
        } else {
            Err(GameError::Ticks { ran, expected })
        }
    }

    /// Lets all worlds report metrics.
    pub fn open_metrics(&mut self, world: &mut World) {
        let is_refused = &self.is_metric_refused;
        self.host
            .for_each_world(world, &mut |_, own| own.metrics.open(is_refused));
    }

    /// Takes what all worlds have reported; none if that is nothing.
    pub fn take_metrics(&mut self, world: &mut World) -> Result<Option<Value>, GameError> {
        let mut sums = Summaries::default();
        let (mut taken, mut number) = (Ok(()), 0);
        self.host.for_each_world(world, &mut |entity, own| {
            let added = own.metrics.take_into(&mut sums);
            if let (Ok(()), Err(error)) = (&taken, added) {
                taken = Err(GameError::Metric {
                    world: number,
                    entity,
                    error,
                });
            }
            number += 1;
        });
        taken.map(|()| sums.into_request())
    }

    /// Sends the batch.
    pub fn answer(&mut self, world: &mut World, flags: u32) -> Result<(), Failure> {
        if self.is_metric_refused.load(Ordering::Relaxed) {
            self.take_metrics(world)?;
        }
        let mut requests = world.resource_mut::<Requests>();
        self.host.take_requests(&mut requests);
        let asks = if self.has_requests && !requests.is_empty() {
            FLAG_REQUESTS
        } else {
            0
        };
        let head = BatchHead {
            tick: self.expected_ticks,
            wait_us: self.wait_us,
            flags: flags | asks,
            ..BatchHead::default()
        };
        self.state.send(FrameType::Batch)?;
        self.host.send_batch(world, head, &mut self.link)
    }
}

/// Makes the worlds, in the layout that the trainer and the game agree on.
fn make_host(
    world: &mut World,
    worlds: IsolatedWorlds,
    settings: &Settings,
    opening: Opening,
) -> Result<Box<dyn Host>, GameError> {
    if opening.layout == WorldLayout::Isolated {
        let fill = worlds.fill.ok_or(GameError::NotDivisible)?;
        return Ok(Box::new(IsolatedApps::open(fill, settings, opening)?));
    }
    open(world, opening)?;
    #[cfg(feature = "camera")]
    crate::camera::check_renderer(world)?;
    Ok(Box::new(GridHost))
}
