//! Policies: what agents with one network have in common.

use crate::components::{Action, ActionMask, Observation};
use crate::space::{ActionSpace, ObservationSpace, RowReader};
use crate::wire::{
    ActionComponent, ActionFrame, ActionLayout, EpisodeMode, ObservationEntry, PolicySpec, Spec,
    WorldLayout,
};
use bevy_ecs::prelude::*;
use serde_json::{Map, Value};

/// A policy of the game: a name, and how its agents are trained.
#[derive(Clone, Debug)]
pub struct Policy {
    pub(crate) name: String,
    pub(crate) max_episode_steps: Option<u32>,
    pub(crate) spare_slots: usize,
    pub(crate) has_action_mask: bool,
    pub(crate) settings: Map<String, Value>,
    #[cfg(feature = "camera")]
    pub(crate) cameras: Vec<(String, crate::camera::Picture)>,
}

impl Policy {
    /// Makes a policy with a name of 1 to 128 characters.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            max_episode_steps: None,
            spare_slots: 0,
            has_action_mask: false,
            settings: Map::new(),
            #[cfg(feature = "camera")]
            cameras: Vec::new(),
        }
    }

    /// Adds an entry to the observation, after those of its struct: what each agent's
    /// [`LudusCamera`](crate::camera::LudusCamera) of that name sees. A policy whose agents see
    /// nothing else has the observation `()`.
    #[cfg(feature = "camera")]
    #[must_use]
    pub fn camera(mut self, entry: impl Into<String>, picture: crate::camera::Picture) -> Self {
        self.cameras.push((entry.into(), picture));
        self
    }

    #[cfg(feature = "camera")]
    fn with_camera_entries(&self, mut entries: Vec<ObservationEntry>) -> Vec<ObservationEntry> {
        let cameras = self.cameras.iter();
        entries.extend(cameras.map(|(name, picture)| picture.entry(name)));
        entries
    }

    /// Truncates episodes after this many steps.
    #[must_use]
    pub fn max_episode_steps(mut self, steps: u32) -> Self {
        self.max_episode_steps = Some(steps);
        self
    }

    /// Keeps slots free in every world, for agents that join later.
    #[must_use]
    pub fn spare_slots(mut self, count: usize) -> Self {
        self.spare_slots = count;
        self
    }

    /// Lets the game say which choices are allowed, in [`ActionMask`] components.
    #[must_use]
    pub fn with_action_mask(mut self) -> Self {
        self.has_action_mask = true;
        self
    }

    /// Sets a training setting, by the trainer's name, such as `learning_rate`.
    #[must_use]
    pub fn setting(mut self, name: impl Into<String>, value: impl Into<Value>) -> Self {
        self.settings.insert(name.into(), value.into());
        self
    }
}

/// A policy together with its spaces.
#[derive(Clone, Debug)]
pub(crate) struct PolicyEntry {
    pub policy: Policy,
    pub observation: Vec<ObservationEntry>,
    pub action: Vec<ActionComponent>,
    /// Gives an agent the components it lacks.
    pub insert_components: fn(&mut EntityWorldMut<'_>),
}

impl PolicyEntry {
    pub fn new<O: ObservationSpace, A: ActionSpace>(policy: Policy) -> Self {
        let observation = O::entries();
        #[cfg(feature = "camera")]
        let observation = policy.with_camera_entries(observation);
        Self {
            policy,
            observation,
            action: A::components(),
            insert_components: insert_components::<O, A>,
        }
    }

    /// Describes the policy, still without agents.
    pub fn to_spec(&self, episode: EpisodeMode) -> PolicySpec {
        PolicySpec {
            name: self.policy.name.clone(),
            num_agents: 0,
            agents_per_world: 0,
            episode,
            max_episode_steps: self.policy.max_episode_steps.map(u64::from),
            observation: self.observation.clone(),
            action: self.action.clone(),
            has_action_mask: self.policy.has_action_mask,
            agents: Vec::new(),
            settings: self.policy.settings.clone(),
        }
    }

    /// Gives an agent the components it lacks, and its mask.
    pub fn insert_missing(&self, agent: &mut EntityWorldMut<'_>) {
        (self.insert_components)(agent);
        if self.policy.has_action_mask && !agent.contains::<ActionMask>() {
            let size = self.to_spec(EpisodeMode::Agent).mask_size();
            agent.insert(ActionMask(vec![1; size]));
        }
    }
}

/// All policies of an app, in wire order.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct Policies {
    pub entries: Vec<PolicyEntry>,
}

impl Policies {
    pub fn find(&self, name: &str) -> Option<usize> {
        self.entries
            .iter()
            .position(|entry| entry.policy.name == name)
    }
}

fn insert_components<O: ObservationSpace, A: ActionSpace>(agent: &mut EntityWorldMut<'_>) {
    if !agent.contains::<Observation<O>>() {
        agent.insert(Observation(O::zero()));
    }
    if !agent.contains::<Action<A>>() {
        agent.insert(Action(first_action::<A>()));
    }
}

/// Returns the action that is all zeros: what an agent has before its first decision.
fn first_action<A: ActionSpace>() -> A {
    let policy = PolicySpec {
        name: String::new(),
        num_agents: 1,
        agents_per_world: 1,
        episode: EpisodeMode::Agent,
        max_episode_steps: None,
        observation: Vec::new(),
        action: A::components(),
        has_action_mask: false,
        agents: Vec::new(),
        settings: Map::new(),
    };
    let spec = Spec {
        num_worlds: 1,
        layout: WorldLayout::Grid,
        ticks_per_step: 1,
        tick_rate: 1.0,
        scene: String::new(),
        policies: vec![policy],
    };
    let frame = ActionFrame::new(ActionLayout::new(&spec));
    A::read(&mut RowReader::new(frame.row(0, 0)))
}
