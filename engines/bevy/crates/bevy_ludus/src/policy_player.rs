//! Agents that trained policies play, while no trainer is there (POLICY.md §5).

use crate::error::{GameError, print_error};
use crate::model::{ActionHead, PolicyFrames, PolicyModel, PolicyNetwork};
use crate::policy_plugin::{EpisodeEnded, PolicySources};
use crate::random::RandomStream;
use crate::stage::Stage;
use crate::wire::{DType, ObservationEntry, PolicySpec, Spec};
use std::io::Write;

/// All policies that are played from files.
#[derive(Debug, Default)]
pub(crate) struct PolicyPlayer {
    played: Vec<PlayedPolicy>,
    has_report: bool,
}

impl PolicyPlayer {
    /// Reads the policies of a game and fits them to its agents.
    pub fn open(spec: &Spec, sources: &PolicySources, seed: u64) -> Result<Self, GameError> {
        let mut played = Vec::new();
        for (name, place, model) in sources.load() {
            let Some(index) = spec.policies.iter().position(|own| own.name == name) else {
                let known: Vec<_> = spec.policies.iter().map(|own| own.name.as_str()).collect();
                return Err(GameError::NoSuchPolicy {
                    name: name.to_owned(),
                    known: known.join(", "),
                });
            };
            let agents = &spec.policies[index];
            let fitted = model.and_then(|model| model.fit(agents).map(|entries| (model, entries)));
            let (model, entries) = fitted.map_err(|error| GameError::PolicyFile {
                policy: name.to_owned(),
                place,
                error,
            })?;
            let mut one = PlayedPolicy::new(&model, entries, index, agents);
            if sources.sample_actions {
                one.random = Some(RandomStream::of_episode(seed, index as u64));
            }
            played.push(one);
        }
        Ok(Self {
            played,
            has_report: sources.has_report,
        })
    }

    /// Returns whether the game, or a person, plays all agents.
    pub fn is_idle(&self) -> bool {
        self.played.is_empty()
    }

    /// Returns whether a policy plays from a file.
    pub fn plays(&self, policy: usize) -> bool {
        self.played.iter().any(|played| played.policy == policy)
    }

    /// Lets all agents that play decide on what they see now.
    pub fn act(&mut self, stage: &mut Stage) {
        for played in &mut self.played {
            played.act(stage);
        }
    }

    /// Takes in what a step has brought, and passes on which episodes have ended.
    ///
    /// # Errors
    /// The program that reads the report has closed it.
    pub fn collect(
        &mut self,
        stage: &Stage,
        mut report_end: impl FnMut(EpisodeEnded),
    ) -> std::io::Result<()> {
        let mut reported = Ok(());
        for played in &mut self.played {
            played.collect(stage, |ended| {
                if self.has_report && reported.is_ok() {
                    reported = print_episode(&ended);
                }
                report_end(ended);
            });
        }
        reported
    }

    /// Lets agents whose episode has begun forget the one before.
    pub fn note_begun(&mut self, stage: &Stage) {
        for played in &mut self.played {
            played.note_begun(stage);
        }
    }
}

/// The agents of one policy.
#[derive(Debug)]
struct PlayedPolicy {
    name: String,
    /// Index in the spec.
    policy: usize,
    /// What the policy looks at.
    observation: Vec<ObservationEntry>,
    /// Of every entry of the policy: the index of the agents' one.
    entries: Vec<usize>,
    /// Whether a number that is NaN or infinite was told of.
    has_warned: bool,
    /// What agents saw before, where the policy looks at that.
    frames: Option<PolicyFrames>,
    network: PolicyNetwork,
    head: ActionHead,
    /// Draws actions; none takes the most probable ones.
    random: Option<RandomStream>,
    memory: Vec<f32>,
    /// Slots that act in this step.
    slots: Vec<usize>,
    is_playing: Vec<bool>,
    returns: Vec<f64>,
    num_steps: Vec<u32>,
    choices: Vec<i64>,
    numbers: Vec<f32>,
}

impl PlayedPolicy {
    fn new(model: &PolicyModel, entries: Vec<usize>, policy: usize, agents: &PolicySpec) -> Self {
        let num_agents = agents.num_agents as usize;
        let (network, head) = (PolicyNetwork::new(model), ActionHead::new(model));
        Self {
            name: agents.name.clone(),
            policy,
            observation: model.observation.clone(),
            entries,
            has_warned: false,
            frames: (model.frames > 1).then(|| PolicyFrames::new(model, num_agents)),
            random: None,
            memory: vec![0.0; network.memory_size() * num_agents],
            slots: Vec::with_capacity(num_agents),
            is_playing: vec![false; num_agents],
            returns: vec![0.0; num_agents],
            num_steps: vec![0; num_agents],
            choices: vec![0; head.num_choices()],
            numbers: vec![0.0; head.num_numbers()],
            network,
            head,
        }
    }

    fn act(&mut self, stage: &mut Stage) {
        let Stage {
            batch,
            actions,
            rosters,
            ..
        } = stage;
        self.slots.clear();
        let active = rosters[self.policy].active.iter().enumerate();
        self.slots.extend(
            active
                .filter(|(_, active)| **active == 1)
                .map(|(slot, _)| slot),
        );
        let arrays = &batch.layout().policies[self.policy];
        let bytes = batch.bytes();
        let seen = |entry: usize, slot: usize| {
            let own: usize = self.entries[entry];
            &bytes[arrays.entries[own].row(slot)]
        };
        if !self.has_warned
            && let Some((slot, number)) = find_infinite(&self.observation, &self.slots, seen)
        {
            self.has_warned = true;
            let warning = format!("{}: agent {slot}: {number}", self.name);
            print_error(&warning, "look for a division by zero in the game");
        }
        if let Some(frames) = &mut self.frames {
            frames.push(seen, &self.slots);
        }
        let row = |entry: usize, slot: usize| match &self.frames {
            Some(frames) => frames.row(entry, slot),
            None => seen(entry, slot),
        };
        let outputs = self.network.run(row, &self.slots, &mut self.memory);
        let width = outputs.len() / self.slots.len().max(1);
        for (number, slot) in self.slots.iter().enumerate() {
            let outputs = &outputs[number * width..(number + 1) * width];
            let mask = &bytes[arrays.mask.row(*slot)];
            let random = self.random.as_mut();
            let (choices, numbers) = (&mut self.choices, &mut self.numbers);
            self.head.choose(outputs, mask, random, choices, numbers);
            let target = &mut actions.discrete_mut(self.policy)[slot * choices.len()..];
            for (bytes, choice) in target.iter_mut().zip(choices) {
                *bytes = choice.to_le_bytes();
            }
            let target = &mut actions.continuous_mut(self.policy)[slot * numbers.len()..];
            for (bytes, number) in target.iter_mut().zip(numbers) {
                *bytes = number.to_le_bytes();
            }
        }
    }

    fn collect(&mut self, stage: &Stage, mut report_end: impl FnMut(EpisodeEnded)) {
        let rewards = stage.batch.layout().policies[self.policy].reward;
        let roster = &stage.rosters[self.policy];
        self.is_playing.fill(false);
        for slot in self.slots.iter().copied() {
            let bytes = stage.batch.bytes()[rewards.row(slot)].first_chunk();
            let reward = bytes.map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
            self.returns[slot] += f64::from(reward);
            self.num_steps[slot] += 1;
            self.is_playing[slot] = roster.active[slot] == 1;
            if !self.is_playing[slot] {
                report_end(EpisodeEnded {
                    policy: self.name.clone(),
                    agent: roster.agents[slot],
                    episode_return: self.returns[slot],
                    num_steps: self.num_steps[slot],
                });
            }
        }
    }

    fn note_begun(&mut self, stage: &Stage) {
        let size = self.network.memory_size();
        for (slot, active) in stage.rosters[self.policy].active.iter().enumerate() {
            if *active == 1 && !self.is_playing[slot] {
                self.memory[slot * size..(slot + 1) * size].fill(0.0);
                if let Some(frames) = &mut self.frames {
                    frames.begin(slot);
                }
                self.returns[slot] = 0.0;
                self.num_steps[slot] = 0;
            }
        }
    }
}

/// Names the first number that is NaN or infinite, and its slot: what it decides is arbitrary.
fn find_infinite<'a>(
    observation: &[ObservationEntry],
    slots: &[usize],
    seen: impl Fn(usize, usize) -> &'a [u8],
) -> Option<(usize, String)> {
    let floats = observation.iter().enumerate();
    for (entry, described) in floats.filter(|(_, one)| one.dtype == DType::Float32) {
        for slot in slots.iter().copied() {
            let (bytes, _) = seen(entry, slot).as_chunks();
            let numbers = bytes.iter().copied().map(f32::from_le_bytes);
            if let Some((i, number)) = numbers.enumerate().find(|(_, one)| !one.is_finite()) {
                let name = &described.name;
                return Some((slot, format!("observation[\"{name}\"][{i}] is {number}")));
            }
        }
    }
    None
}

/// Prints a line for an episode, as POLICY.md §5 says.
fn print_episode(ended: &EpisodeEnded) -> std::io::Result<()> {
    let line = serde_json::json!({
        "policy": ended.policy, "return": ended.episode_return, "length": ended.num_steps,
    });
    writeln!(std::io::stdout(), "ludus-episode {line}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(name: &str, dtype: DType) -> ObservationEntry {
        let (name, shape) = (name.to_owned(), vec![2]);
        ObservationEntry {
            name,
            dtype,
            shape,
            low: None,
            high: None,
        }
    }

    #[test]
    fn the_first_number_that_is_not_finite_is_named() {
        let entries = [
            entry("pixels", DType::Uint8),
            entry("place", DType::Float32),
        ];
        let bytes = |numbers: [f32; 2]| numbers.map(f32::to_le_bytes).concat();
        let (right, wrong) = (bytes([0.0, 1.0]), bytes([0.0, f32::NAN]));
        let seen = |entry: usize, slot: usize| match (entry, slot) {
            (0, _) => &[255, 255][..],
            (_, 3) => wrong.as_slice(),
            _ => right.as_slice(),
        };
        assert_eq!(find_infinite(&entries, &[0, 1], seen), None);
        let found = find_infinite(&entries, &[0, 3], seen);
        assert_eq!(
            found,
            Some((3, "observation[\"place\"][1] is NaN".to_owned()))
        );
    }
}
