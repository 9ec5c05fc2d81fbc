//! What the environment and its clients share.

use super::queue::{Ask, Kind, RequestQueue};
use super::settings::AIGymSettings;
use bevy_ecs::resource::Resource;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex};

/// State, rewards and endings as clients see them. It lives behind the lock of [`AIGymState`].
///
/// `A` is the type of actions, `B` that of the state.
#[derive(Debug, Resource)]
pub struct AIGymStateInner<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    /// One image per agent: the targets for cameras. Filled in startup, if
    /// [`render_to_buffer`](AIGymSettings::render_to_buffer) is set.
    #[cfg(feature = "camera")]
    pub render_image_handles: Vec<bevy_asset::Handle<bevy_image::Image>>,
    /// The settings, as the environment gave them.
    pub settings: AIGymSettings,
    /// Of each agent, as of the last step.
    pub rewards: Vec<f32>,
    /// For the environment's own use.
    pub actions: Vec<Option<A>>,
    /// Whether the agents have ended.
    pub terminations: Vec<bool>,
    pub(super) environment_state: Option<B>,
    /// What the environment did wrong since the last answer.
    pub(super) fault: Option<String>,
    pub(super) queue: Arc<RequestQueue>,
}

impl<A, B> AIGymStateInner<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    /// Begins with rewards of 0, and no agent ended.
    #[must_use]
    pub fn new(settings: AIGymSettings) -> Self {
        let num_agents = settings.num_agents as usize;
        Self {
            #[cfg(feature = "camera")]
            render_image_handles: Vec::new(),
            rewards: vec![0.0; num_agents],
            actions: vec![None; num_agents],
            terminations: vec![false; num_agents],
            environment_state: None,
            fault: None,
            queue: Arc::new(RequestQueue::new(settings.is_lock_step())),
            settings,
        }
    }

    /// Says that the step is done. Without this call, a step is done when the game has run and is
    /// paused again.
    ///
    /// In lock-step the answer goes out when the game stands still. What the list says is of no
    /// importance, as in bevy_rl.
    #[allow(clippy::needless_pass_by_value)]
    pub fn send_step_result(&self, _results: Vec<bool>) {
        self.queue.note_result(Kind::Step);
    }

    /// Says that the new episode has begun. Without this call, it has when the game has run and is
    /// paused again.
    pub fn send_reset_result(&self, _result: bool) {
        self.queue.note_result(Kind::Reset);
    }

    /// Takes the actions that a client has sent, one text or none per agent; one `None` per agent if
    /// no client has. The step is then done when the game calls
    /// [`send_step_result`](Self::send_step_result). Games that read
    /// [`EventControl`](super::EventControl) have no use for this.
    pub fn receive_action_strings(&self) -> Vec<Option<String>> {
        match self.queue.receive(Kind::Step) {
            Some(Ask::Step(actions)) => actions,
            _ => vec![None; self.settings.num_agents as usize],
        }
    }

    /// Takes the request for a new episode, if there is one. It is done when the game calls
    /// [`reset`](Self::reset) or [`send_reset_result`](Self::send_reset_result). Games that read
    /// [`EventReset`](super::EventReset) have no use for this.
    pub fn receive_reset_request(&self) {
        self.queue.receive(Kind::Reset);
    }

    /// Returns whether actions of a client wait to be received.
    #[must_use]
    pub fn is_next_action(&self) -> bool {
        self.queue.poll(Kind::Step)
    }

    /// Returns whether a client's request for a new episode waits to be received.
    #[must_use]
    pub fn is_reset_request(&self) -> bool {
        self.queue.poll(Kind::Reset)
    }

    /// Sets the reward of an agent. With an agent that does not exist, the client gets the status
    /// 500 and a reason.
    pub fn set_reward(&mut self, agent_index: usize, score: f32) {
        match self.rewards.get_mut(agent_index) {
            Some(reward) => *reward = score,
            None => self.note_fault("set_reward", agent_index),
        }
    }

    /// Sets whether an agent has ended. With an agent that does not exist, the client gets the
    /// status 500 and a reason.
    pub fn set_terminated(&mut self, agent_index: usize, result: bool) {
        match self.terminations.get_mut(agent_index) {
            Some(is_terminated) => *is_terminated = result,
            None => self.note_fault("set_terminated", agent_index),
        }
    }

    /// Begins a new episode: rewards are 0, no agent has ended, and the client that asked for it is answered.
    pub fn reset(&mut self) {
        self.rewards.fill(0.0);
        self.terminations.fill(false);
        self.send_reset_result(true);
    }

    /// Publishes the state of the environment.
    pub fn set_env_state(&mut self, state: B) {
        self.environment_state = Some(state);
    }

    fn note_fault(&mut self, method: &str, agent_index: usize) {
        let num_agents = self.settings.num_agents;
        self.fault.get_or_insert_with(|| {
            format!(
                "the game called {method}({agent_index}, …), but there are {num_agents} agents\n\
                 hint: agents are counted from 0; AIGymSettings::num_agents says how many there are"
            )
        });
    }
}

/// [`AIGymStateInner`], shared between the systems of the game and the server.
#[derive(Debug, Resource)]
pub struct AIGymState<A, B>(pub Arc<Mutex<AIGymStateInner<A, B>>>)
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone;

impl<A, B> AIGymState<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    /// Insert it as a resource before you add [`AIGymPlugin`](super::AIGymPlugin).
    #[must_use]
    pub fn new(settings: AIGymSettings) -> Self {
        Self(Arc::new(Mutex::new(AIGymStateInner::new(settings))))
    }
}

impl<A, B> Clone for AIGymState<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<A, B> Deref for AIGymState<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    type Target = Arc<Mutex<AIGymStateInner<A, B>>>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<A, B> DerefMut for AIGymState<A, B>
where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}
