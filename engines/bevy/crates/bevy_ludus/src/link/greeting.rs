//! Greeting the trainer, and taking its settings once it has proved itself (PROTOCOL.md §3).

use super::{CommandLine, Link, LinkError};
use crate::training::Failure;
use crate::wire::{
    CAPABILITIES, Challenge, ConnectionState, EngineConfig, EngineName, ErrorCode, ErrorReport,
    FrameType, Hello, MAX_WORLDS, Nonce, PROTOCOL_MAX, PROTOCOL_MIN, Proof, Role, Versions,
    Welcome, encode_json, from_hex, is_proof, make_proof, read_object, to_hex,
};
use serde::Deserialize;

pub(super) const MIN_TOKEN_LENGTH: usize = 16;
/// The version of Bevy that this crate is made for.
const BEVY_VERSION: &str = "0.19.1";

/// What an `ERROR` in place of a `CHALLENGE` says, and of whom it is.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Refusal {
    message: String,
    nonce: String,
    proof: String,
}

/// The first frames of a conversation: both sides prove that they know the token, and neither tells
/// it.
#[derive(Debug)]
pub(super) struct Greeting {
    token: String,
    nonce: Nonce,
    pub state: ConnectionState,
}

impl Greeting {
    pub fn new(token: String) -> Result<Self, Failure> {
        if token.is_empty() {
            let text = "there is no token, so that a trainer cannot prove itself";
            return Err(Failure::new(ErrorCode::Token, text, ""));
        }
        let mut nonce = Nonce::default();
        getrandom::fill(&mut nonce)
            .map_err(|error| Failure::new(ErrorCode::Internal, error.to_string(), ""))?;
        Ok(Self {
            token,
            nonce,
            state: ConnectionState::default(),
        })
    }

    /// Returns the first frame.
    pub fn hello(&mut self) -> Result<Vec<u8>, Failure> {
        self.state.send(FrameType::Hello)?;
        let hello = Hello {
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
            nonce: to_hex(&self.nonce),
            training: None,
        };
        Ok(encode_json(FrameType::Hello, &hello)?)
    }

    /// Takes in the answer to it. Returns the last frame of the greeting, once the trainer has proved
    /// itself.
    pub fn prove(&mut self, kind: FrameType, payload: &[u8]) -> Result<Vec<u8>, Failure> {
        self.state.receive(kind)?;
        match kind {
            FrameType::Error => return Err(refused(payload)?),
            FrameType::Close => return Err(LinkError::Closed.into()),
            _ => {}
        }
        let challenge: Challenge = read_object(payload, "CHALLENGE")?;
        let read = |text: &str| {
            from_hex(text).ok_or_else(|| {
                let text = "a CHALLENGE has a nonce and a proof of 64 hexadecimal digits each";
                Failure::new(ErrorCode::Frame, text, "")
            })
        };
        let (theirs, proof) = (read(&challenge.nonce)?, read(&challenge.proof)?);
        if !is_proof(&proof, &self.token, Role::Trainer, &self.nonce, &theirs) {
            let hint = "give both sides the same token file (--ludus-token-file, --token-file)";
            let text = "the trainer's token is not ours";
            return Err(Failure::new(ErrorCode::Token, text, hint));
        }
        self.state.send(FrameType::Proof)?;
        let ours = make_proof(&self.token, Role::Engine, &self.nonce, &theirs);
        let proof = Proof {
            proof: to_hex(&ours),
        };
        Ok(encode_json(FrameType::Proof, &proof)?)
    }

    /// Returns the message of an `ERROR` in place of the `CHALLENGE` that does not prove itself the
    /// trainer's; none if it does.
    pub fn unproven(&self, payload: &[u8]) -> Result<Option<String>, Failure> {
        let refusal: Refusal = read_object(payload, "ERROR")?;
        let is_trainers = match (from_hex(&refusal.nonce), from_hex(&refusal.proof)) {
            (Some(theirs), Some(proof)) => {
                is_proof(&proof, &self.token, Role::Trainer, &self.nonce, &theirs)
            }
            _ => false,
        };
        Ok((!is_trainers).then_some(refusal.message))
    }
}

/// Greets the trainer. Returns the state of the conversation and what the trainer asks for.
pub(crate) fn greet(
    link: &mut Link,
    command_line: &CommandLine,
) -> Result<(ConnectionState, Welcome), Failure> {
    let mut state = match link.proven.take() {
        Some(state) => state,
        None => prove_ourselves(link, command_line)?,
    };
    let kind = link.receive()?;
    state.receive(kind)?;
    match kind {
        FrameType::Error => return Err(refused(link.payload())?),
        FrameType::Close => return Err(LinkError::Closed.into()),
        _ => {}
    }
    let welcome: Welcome = read_object(link.payload(), "WELCOME")
        .map_err(|error| Failure::new(ErrorCode::Config, error.to_string(), ""))?;
    check(&welcome)?;
    Ok((state, welcome))
}

/// Lets both sides prove themselves to each other.
fn prove_ourselves(
    link: &mut Link,
    command_line: &CommandLine,
) -> Result<ConnectionState, Failure> {
    let token = command_line.token_for(link.is_local)?;
    if !link.is_local && token.chars().count() < MIN_TOKEN_LENGTH {
        let text = "a connection to another machine needs a token of 16 characters";
        let hint = "write it into a file and name it on both sides (--ludus-token-file)";
        return Err(Failure::new(ErrorCode::Token, text, hint));
    }
    let mut greeting = Greeting::new(token)?;
    link.send(&greeting.hello()?)?;
    let kind = link.receive()?;
    let proof = greeting.prove(kind, link.payload())?;
    link.send(&proof)?;
    Ok(greeting.state)
}

/// Returns the failure that the trainer's own report is.
fn refused(payload: &[u8]) -> Result<Failure, Failure> {
    let report: ErrorReport = read_object(payload, "ERROR")?;
    Ok(Failure::Trainer(report.message))
}

fn check(welcome: &Welcome) -> Result<(), Failure> {
    let version = welcome.protocol;
    if !(PROTOCOL_MIN..=PROTOCOL_MAX).contains(&version) {
        let text = format!("the trainer chose protocol {version}, which this crate lacks");
        return Err(Failure::new(ErrorCode::Version, text, "upgrade bevy_ludus"));
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn only_a_trainer_that_knows_the_token_can_refuse() {
        let greeting = Greeting::new("a token of 16 characters".to_owned()).unwrap();
        let theirs = Nonce::default();
        let proof = |token: &str, role| to_hex(&make_proof(token, role, &greeting.nonce, &theirs));
        let right = proof(&greeting.token, Role::Trainer);
        let unproven = |nonce: &str, proof: &str| {
            let report = json!({"code": "later", "message": "no", "nonce": nonce, "proof": proof});
            greeting.unproven(report.to_string().as_bytes()).unwrap()
        };
        let nonce = to_hex(&theirs);
        assert_eq!(unproven(&nonce, &right), None);
        let said = Some("no".to_owned());
        for wrong in [
            "",
            &nonce,
            &right[2..],
            &proof(&greeting.token, Role::Engine),
            &proof("another token of 16", Role::Trainer),
        ] {
            assert_eq!(unproven(&nonce, wrong), said, "{wrong}");
        }
        assert_eq!(unproven("", &right), said);
        assert_eq!(unproven(&to_hex(&greeting.nonce), &right), said);
        assert_eq!(greeting.unproven(b"{}").unwrap(), Some(String::new()));
        assert!(greeting.unproven(b"{\"nonce\": 1}").is_err());
    }
}
