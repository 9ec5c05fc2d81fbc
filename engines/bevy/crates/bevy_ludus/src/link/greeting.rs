//! Greeting the trainer and taking its settings (PROTOCOL.md §3).

use super::{CommandLine, Link};
use crate::training::Failure;
use crate::wire::{
    CAPABILITIES, ConnectionState, EngineConfig, EngineName, ErrorCode, ErrorReport, FrameType,
    Hello, MAX_WORLDS, PROTOCOL_MAX, PROTOCOL_MIN, Versions, Welcome, encode_json, is_same_token,
    read_object,
};

const MIN_TOKEN_LENGTH: usize = 16;
/// The version of Bevy that this crate is made for.
const BEVY_VERSION: &str = "0.19.1";

/// Greets the trainer. Returns the state of the conversation and what the trainer asks for.
pub(crate) fn greet(
    link: &mut Link,
    command_line: &CommandLine,
) -> Result<(ConnectionState, Welcome), Failure> {
    let token = &command_line.token;
    if !link.is_local && token.chars().count() < MIN_TOKEN_LENGTH {
        let text = "a connection to another machine needs a token of 16 characters";
        let hint = "write it into a file and name it on both sides (--ludus-token-file)";
        return Err(Failure::new(ErrorCode::Token, text, hint));
    }
    let mut state = ConnectionState::default();
    link.send(&encode_json(FrameType::Hello, &hello(token))?)?;
    state.send(FrameType::Hello)?;
    let kind = link.receive()?;
    state.receive(kind)?;
    if kind == FrameType::Error {
        let report: ErrorReport = read_object(link.payload(), "ERROR")?;
        return Err(Failure::Trainer(report.message));
    }
    if kind == FrameType::Close {
        return Err(super::LinkError::Closed.into());
    }
    let welcome: Welcome = read_object(link.payload(), "WELCOME")
        .map_err(|error| Failure::new(ErrorCode::Config, error.to_string(), ""))?;
    check(&welcome, link.is_local, token)?;
    Ok((state, welcome))
}

fn hello(token: &str) -> Hello {
    Hello {
        protocol: Versions {
            min: PROTOCOL_MIN,
            max: PROTOCOL_MAX,
        },
        addon: env!("CARGO_PKG_VERSION").to_owned(),
        engine: EngineName {
            name: "bevy".to_owned(),
            version: BEVY_VERSION.to_owned(),
        },
        capabilities: CAPABILITIES.map(str::to_owned).to_vec(),
        token: token.to_owned(),
        training: None,
    }
}

fn check(welcome: &Welcome, is_local: bool, token: &str) -> Result<(), Failure> {
    let version = welcome.protocol;
    if !(PROTOCOL_MIN..=PROTOCOL_MAX).contains(&version) {
        let text = format!("the trainer chose protocol {version}, which this crate lacks");
        return Err(Failure::new(ErrorCode::Version, text, "upgrade bevy_ludus"));
    }
    if !is_local && !is_same_token(token, &welcome.token) {
        return Err(Failure::new(
            ErrorCode::Token,
            "the trainer sent another token",
            "",
        ));
    }
    check_config(&welcome.config)
}

fn check_config(config: &EngineConfig) -> Result<(), Failure> {
    let refuse = |text: String| Err(Failure::new(ErrorCode::Config, text, ""));
    if let Some(scene) = &config.scene {
        return refuse(format!(
            "there is no scene \"{scene}\": a Bevy game is one program"
        ));
    }
    if !(1..=MAX_WORLDS).contains(&config.num_worlds) {
        let count = config.num_worlds;
        return refuse(format!("num_worlds is {count}, expected 1 to {MAX_WORLDS}"));
    }
    for (name, value) in [
        ("ticks_per_step", config.ticks_per_step),
        ("max_episode_steps", config.max_episode_steps),
    ] {
        if value == Some(0) {
            return refuse(format!("{name} is 0, expected at least 1"));
        }
    }
    Ok(())
}
