//! What clients read of the shared state, as JSON.

use super::error::Refusal;
use super::state::{AIGymState, AIGymStateInner};
use serde::Serialize;
use std::sync::{MutexGuard, PoisonError};

/// The shared state without its types.
pub(super) trait Export: Send + Sync {
    /// Returns rewards and endings of all agents, `[{"is_terminated":false,"reward":0.0}, …]`.
    ///
    /// # Errors
    /// The game named an agent that does not exist.
    fn agents(&self) -> Result<String, Refusal>;

    /// Returns the published state; `null` if there is none yet.
    ///
    /// # Errors
    /// The state cannot be written as JSON.
    fn state(&self) -> Result<String, Refusal>;
}

/// An agent in the answer; in the order of the alphabet, as bevy_rl writes it.
#[derive(Serialize)]
struct AgentAnswer {
    is_terminated: bool,
    reward: f64,
}

impl<A, B> Export for AIGymState<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone + Serialize,
{
    fn agents(&self) -> Result<String, Refusal> {
        let mut gym = read(self);
        if let Some(fault) = gym.fault.take() {
            return Err(Refusal::game(fault));
        }
        let pairs = gym.rewards.iter().zip(&gym.terminations);
        let agents: Vec<_> = pairs
            .map(|(reward, is_terminated)| AgentAnswer {
                is_terminated: *is_terminated,
                reward: f64::from(*reward),
            })
            .collect();
        drop(gym);
        serde_json::to_string(&agents).map_err(|error| Refusal::game(error.to_string()))
    }

    fn state(&self) -> Result<String, Refusal> {
        // Through a value, as bevy_rl does: it sorts the fields and widens numbers.
        let value = serde_json::to_value(&read(self).environment_state);
        value
            .map(|value| value.to_string())
            .map_err(|error| Refusal::game(format!("the state of the game is not JSON: {error}")))
    }
}

/// Locks the state. A system that panicked has left it whole: each field is set at once.
pub(super) fn read<A, B>(gym: &AIGymState<A, B>) -> MutexGuard<'_, AIGymStateInner<A, B>>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    gym.lock().unwrap_or_else(PoisonError::into_inner)
}
