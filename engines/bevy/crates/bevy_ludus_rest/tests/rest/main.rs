//! Environments as they are written for bevy_rl, in real apps, asked over real sockets.
#![allow(clippy::unwrap_used)]

mod both;
mod client;
mod endings;
mod endpoints;
mod faults;
mod game;
mod lock_step;
mod pixels;
mod polling;
mod published;
mod refusals;
mod strangers;
#[cfg(feature = "camera")]
#[allow(dead_code)]
mod trainer;
