//! Environments as they are written for bevy_rl, in real apps, asked over real sockets.
#![cfg(feature = "rest")]
#![allow(clippy::unwrap_used)]

mod both;
mod client;
mod endings;
mod endpoints;
mod faults;
mod game;
mod lock_step;
mod pixels;
mod refusals;
#[cfg(feature = "camera")]
#[allow(dead_code)]
#[path = "../plugin/trainer.rs"]
mod trainer;
