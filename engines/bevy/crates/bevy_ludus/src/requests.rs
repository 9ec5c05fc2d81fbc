//! What the game asks of the trainer, and how it learns about the training (PROTOCOL.md §8).

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};

const MAX_WAITING: usize = 256;

/// How a policy takes part in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// It learns.
    Train,
    /// It acts as in training, with chance, and learns nothing.
    Frozen,
    /// It takes its most probable action and learns nothing.
    Deterministic,
}

/// Asks things of the trainer. They wait here until it fetches them, between two steps.
#[derive(Resource, Debug, Default)]
pub struct Requests {
    waiting: VecDeque<Value>,
    is_heard: bool,
}

impl Requests {
    /// Asks for another mode of a policy. Returns whether a trainer takes requests.
    pub fn set_mode(&mut self, policy: &str, mode: Mode) -> bool {
        self.add(json!({"kind": "set_mode", "policy": policy, "mode": mode}))
    }

    /// Asks for a checkpoint. Returns whether a trainer takes requests.
    pub fn save_checkpoint(&mut self) -> bool {
        self.add(json!({"kind": "save"}))
    }

    /// Asks for a checkpoint and the end of the run; the game then quits. Returns whether a trainer
    /// takes requests.
    pub fn stop_training(&mut self) -> bool {
        self.add(json!({"kind": "stop"}))
    }

    /// Puts a request at the end; one that equals it and still waits is dropped, and the oldest if
    /// there are too many.
    fn add(&mut self, request: Value) -> bool {
        if self.is_heard {
            self.waiting.retain(|waiting| *waiting != request);
            if self.waiting.len() == MAX_WAITING {
                self.waiting.pop_front();
            }
            self.waiting.push_back(request);
        }
        self.is_heard
    }
}

/// The trainer's side.
#[cfg(feature = "trainer")]
impl Requests {
    /// Lets requests in.
    pub(crate) fn open(&mut self) {
        self.is_heard = true;
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Takes all requests, oldest first.
    pub(crate) fn take(&mut self) -> Vec<Value> {
        std::mem::take(&mut self.waiting).into()
    }

    /// Takes over the requests of an isolated world.
    pub(crate) fn take_over(&mut self, other: &mut Self) {
        for request in other.take() {
            self.add(request);
        }
    }
}

/// How one policy trains.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PolicyStatus {
    /// The mode it is in.
    pub mode: String,
    /// Mean return of its last episodes; none before the first has ended.
    pub mean_return: Option<f64>,
}

/// How training goes: a message, sent before training and after every update.
#[derive(Message, Clone, Debug, PartialEq, Deserialize)]
pub struct TrainingStatus {
    /// Decisions of all agents so far.
    pub agent_steps: u64,
    /// Updates of the policies so far.
    pub updates: u64,
    /// By name.
    #[serde(default)]
    pub policies: BTreeMap<String, PolicyStatus>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_wait_once_and_the_oldest_falls_out() {
        let mut requests = Requests::default();
        assert!(!requests.save_checkpoint(), "nobody listens yet");
        requests.open();
        assert!(requests.save_checkpoint());
        assert!(requests.set_mode("hero", Mode::Frozen));
        assert!(requests.save_checkpoint());
        let kinds: Vec<_> = requests
            .take()
            .iter()
            .map(|one| one["kind"].clone())
            .collect();
        assert_eq!(kinds, ["set_mode", "save"]);
        for number in 0..=MAX_WAITING {
            requests.set_mode(&number.to_string(), Mode::Train);
        }
        let taken = requests.take();
        assert_eq!(
            (taken.len(), &taken[0]["policy"]),
            (MAX_WAITING, &json!("1"))
        );
        assert!(requests.is_empty());
    }
}
