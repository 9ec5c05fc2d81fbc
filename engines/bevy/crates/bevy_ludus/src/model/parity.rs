//! Answers for the parity test of `ludus export`: what this engine makes of some observations.
//!
//! A folder holds `request.json` and `inputs.bin`: for each step the rows of all agents, entry by
//! entry, then their masks. `answers.bin` is written there: for each step the outputs, log
//! deviations, choices (`i64`) and numbers of all agents, one array after the other.

use super::{ActionHead, PolicyModel, PolicyNetwork};
use serde::Deserialize;
use std::fs;
use std::io::{BufWriter, Error, Write};
use std::path::{Path, PathBuf};

const REQUEST: &str = "request.json";
const INPUTS: &str = "inputs.bin";
const ANSWERS: &str = "answers.bin";

#[derive(Deserialize)]
struct Request {
    policy: PathBuf,
    num_steps: usize,
    num_agents: usize,
    mask_size: usize,
}

/// Answers the request in a folder.
pub(crate) fn answer(folder: &Path) -> Result<(), Error> {
    let request: Request = serde_json::from_slice(&fs::read(folder.join(REQUEST))?)?;
    let model = PolicyModel::load(&request.policy)
        .map_err(|error| Error::other(format!("{}: {error}", request.policy.display())))?;
    let inputs = fs::read(folder.join(INPUTS))?;
    let entries: Vec<_> = model
        .inputs()
        .iter()
        .map(|entry| entry.row_bytes())
        .collect();
    let step_bytes = (entries.iter().sum::<usize>() + request.mask_size) * request.num_agents;
    if inputs.len() != step_bytes * request.num_steps {
        return Err(Error::other(format!("{INPUTS} has {} bytes", inputs.len())));
    }
    let mut answers = BufWriter::new(fs::File::create(folder.join(ANSWERS))?);
    let mut runner = Runner::new(&model, &request);
    for step in inputs.chunks_exact(step_bytes) {
        runner.answer_step(step, &entries, &mut answers)?;
    }
    answers.flush()
}

struct Runner {
    network: PolicyNetwork,
    head: ActionHead,
    slots: Vec<usize>,
    memory: Vec<f32>,
    mask_size: usize,
}

impl Runner {
    fn new(model: &PolicyModel, request: &Request) -> Self {
        let network = PolicyNetwork::new(model);
        Self {
            memory: vec![0.0; network.memory_size() * request.num_agents],
            head: ActionHead::new(model),
            slots: (0..request.num_agents).collect(),
            mask_size: request.mask_size,
            network,
        }
    }

    fn answer_step(
        &mut self,
        step: &[u8],
        entries: &[usize],
        answers: &mut impl Write,
    ) -> Result<(), Error> {
        let num_agents = self.slots.len();
        let start_of = |entry: usize| entries[..entry].iter().sum::<usize>() * num_agents;
        let row = |entry: usize, slot: usize| {
            let start = start_of(entry) + slot * entries[entry];
            &step[start..start + entries[entry]]
        };
        let outputs = self.network.run(row, &self.slots, &mut self.memory);
        let masks = &step[start_of(entries.len())..];
        let (mut choices, mut numbers) = (Vec::new(), Vec::new());
        let mut deviations = Vec::new();
        for (slot, outputs) in outputs.chunks_exact(outputs.len() / num_agents).enumerate() {
            let mask = &masks[slot * self.mask_size..(slot + 1) * self.mask_size];
            let mut chosen = vec![0; self.head.num_choices()];
            let mut decided = vec![0.0; self.head.num_numbers()];
            self.head
                .choose(outputs, mask, None, &mut chosen, &mut decided);
            deviations.extend((0..decided.len()).map(|i| self.head.log_std(outputs, i)));
            choices.extend(chosen);
            numbers.extend(decided);
        }
        write_floats(answers, outputs)?;
        write_floats(answers, &deviations)?;
        for choice in choices {
            answers.write_all(&choice.to_le_bytes())?;
        }
        write_floats(answers, &numbers)
    }
}

fn write_floats(answers: &mut impl Write, numbers: &[f32]) -> Result<(), Error> {
    numbers
        .iter()
        .try_for_each(|number| answers.write_all(&number.to_le_bytes()))
}
