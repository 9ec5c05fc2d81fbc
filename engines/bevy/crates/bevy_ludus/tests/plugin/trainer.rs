//! A trainer in Rust that talks over a real socket with an app on another thread.

use bevy_app::{App, AppExit};
use bevy_ludus::LudusTcpPlugin;
use bevy_ludus::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchHead, BatchLayout, Challenge, ErrorReport, Frame,
    FrameReader, FrameType, Hello, NONCE_BYTES, Proof, ResetAction, ResetRequest, Role, Spec,
    encode_frame, encode_json, from_hex, make_proof, read_object, to_hex,
};
use serde_json::{Value, json};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

const TOKEN: &str = "a token of 16 characters";
const DEADLINE: Duration = Duration::from_secs(20);

/// A trainer that has been greeted.
pub struct Trainer {
    stream: TcpStream,
    reader: FrameReader,
    frames: Vec<Frame>,
    app: JoinHandle<AppExit>,
    pub hello: Hello,
}

impl Trainer {
    /// Starts an app and greets it.
    pub fn connect(fill: impl FnOnce(&mut App) + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = format!("tcp:{}", listener.local_addr().expect("an address"));
        let app = std::thread::spawn(move || {
            let mut app = App::new();
            fill(&mut app);
            let transport = LudusTcpPlugin::default()
                .connect_to(&address)
                .expect("an address")
                .token(TOKEN);
            app.add_plugins(transport).run()
        });
        listener.set_nonblocking(true).expect("a socket");
        let stream = accept(&listener);
        let mut trainer = Self {
            stream,
            reader: FrameReader::default(),
            frames: Vec::new(),
            app,
            hello: serde_json::from_value(json!({
                "protocol": {"min": 0, "max": 0}, "addon": "",
                "engine": {"name": "", "version": ""}, "capabilities": []
            }))
            .expect("an empty greeting"),
        };
        let hello = trainer.receive(FrameType::Hello);
        trainer.hello = read_object(&hello, "HELLO").expect("a greeting");
        trainer.prove();
        trainer
    }

    /// Lets both sides prove that they know the token.
    fn prove(&mut self) {
        let engine = from_hex(&self.hello.nonce).expect("a nonce");
        let ours = [7; NONCE_BYTES];
        let challenge = Challenge {
            protocol: 2,
            nonce: to_hex(&ours),
            proof: to_hex(&make_proof(TOKEN, Role::Trainer, &engine, &ours)),
        };
        self.send(&encode_json(FrameType::Challenge, &challenge).expect("a frame"));
        let proof: Proof = read_object(&self.receive(FrameType::Proof), "PROOF").expect("a proof");
        let expected = make_proof(TOKEN, Role::Engine, &engine, &ours);
        assert_eq!(proof.proof, to_hex(&expected));
    }

    /// Greets the app and returns its spec.
    pub fn configure(&mut self, config: &Value) -> Spec {
        self.welcome(config);
        Spec::decode(&self.receive(FrameType::Spec)).expect("a spec")
    }

    pub fn welcome(&mut self, config: &Value) {
        let welcome = json!({
            "protocol": 2, "client": "test", "capabilities": self.hello.capabilities,
            "config": config,
        });
        self.send(&encode_json(FrameType::Welcome, &welcome).expect("a frame"));
    }

    pub fn send(&mut self, frame: &[u8]) {
        self.stream.write_all(frame).expect("the app listens");
    }

    /// Returns the next frame; none when the app has closed.
    pub fn next_frame(&mut self) -> Option<Frame> {
        let mut bytes = [0; 4096];
        while self.frames.is_empty() {
            let count = match self.stream.read(&mut bytes) {
                Err(error) if error.kind() == ErrorKind::ConnectionReset => 0,
                read => read.expect("an answer within the deadline"),
            };
            if count == 0 {
                return None;
            }
            self.frames = self.reader.feed(&bytes[..count]).expect("frames");
        }
        Some(self.frames.remove(0))
    }

    /// Returns the payload of the next frame, which must be of a type.
    pub fn receive(&mut self, kind: FrameType) -> Vec<u8> {
        let frame = self.next_frame().expect("an answer");
        let text = String::from_utf8_lossy(&frame.payload);
        assert_eq!(frame.kind, kind, "{text}");
        frame.payload
    }

    /// Returns the report with which the app has refused.
    pub fn refusal(&mut self) -> ErrorReport {
        let payload = self.receive(FrameType::Error);
        read_object(&payload, "ERROR").expect("a report")
    }

    pub fn call(&mut self, target: Value, method: &str, arguments: Value) -> Value {
        let call = json!({"id": 3, "target": target, "method": method, "arguments": arguments});
        self.send(&encode_json(FrameType::Call, &call).expect("a frame"));
        let result = self.receive(FrameType::Result);
        let result: Value = serde_json::from_slice(&result).expect("JSON");
        assert_eq!(result["id"], 3);
        result
    }

    /// Says goodbye and returns how the app has ended.
    pub fn close(mut self) -> AppExit {
        self.send(&encode_frame(FrameType::Close, &[]).expect("a frame"));
        self.end()
    }

    /// Waits until the app has ended.
    pub fn end(self) -> AppExit {
        drop(self.stream);
        let began = Instant::now();
        while !self.app.is_finished() {
            assert!(
                began.elapsed() < DEADLINE,
                "the app goes on without a trainer"
            );
            sleep(Duration::from_millis(5));
        }
        self.app.join().expect("the app does not panic")
    }
}

fn accept(listener: &TcpListener) -> TcpStream {
    let began = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false).expect("a socket");
                stream.set_read_timeout(Some(DEADLINE)).expect("a socket");
                return stream;
            }
            Err(_) => {
                assert!(began.elapsed() < DEADLINE, "the app does not connect");
                sleep(Duration::from_millis(5));
            }
        }
    }
}

/// A trainer with a spec, that plays.
pub struct Session {
    pub trainer: Trainer,
    pub spec: Spec,
    pub actions: ActionFrame,
    pub batch: BatchFrame,
}

impl Session {
    pub fn open(fill: impl FnOnce(&mut App) + Send + 'static, config: &Value) -> Self {
        let mut trainer = Trainer::connect(fill);
        let spec = trainer.configure(config);
        Self {
            actions: ActionFrame::new(ActionLayout::new(&spec)),
            batch: BatchFrame::new(BatchLayout::new(&spec)),
            trainer,
            spec,
        }
    }

    /// Resets worlds: `Some(seed)` or none for the next episode of the random stream.
    pub fn reset(&mut self, seeds: &[Option<u64>], parameters: Value) -> BatchHead {
        let action = |seed: &Option<u64>| match seed {
            Some(_) => ResetAction::Seed,
            None => ResetAction::NextEpisode,
        };
        self.reset_with(&ResetRequest {
            seeds: seeds.iter().map(|seed| seed.unwrap_or(0)).collect(),
            actions: seeds.iter().map(action).collect(),
            parameters,
        })
    }

    pub fn reset_with(&mut self, request: &ResetRequest) -> BatchHead {
        self.trainer.send(&request.encode().expect("a frame"));
        self.answer()
    }

    /// Plays a step with the same choice for all agents of the first policy.
    pub fn step(&mut self, choice: i64) -> BatchHead {
        for bytes in self.actions.discrete_mut(0) {
            *bytes = choice.to_le_bytes();
        }
        let frame = encode_frame(FrameType::Step, self.actions.payload()).expect("a frame");
        self.trainer.send(&frame);
        self.answer()
    }

    fn answer(&mut self) -> BatchHead {
        let payload = self.trainer.receive(FrameType::Batch);
        self.batch.decode(&payload).expect("a batch")
    }

    /// Returns the numbers of an observation entry of the first policy, one row per slot.
    pub fn seen(&self, entry: usize) -> Vec<Vec<f32>> {
        let policy = &self.batch.layout().policies[0];
        let row = |slot| floats(&self.batch.bytes()[policy.entries[entry].row(slot)]);
        (0..policy.num_agents).map(row).collect()
    }

    /// Returns the final observations of an entry of the first policy: slot and row.
    pub fn finals(&self, entry: usize) -> Vec<(u32, Vec<f32>)> {
        let finals = &self.batch.finals[0];
        let row_bytes = self.batch.layout().policies[0].entries[entry].row_bytes;
        let rows = finals.entries[entry].chunks(row_bytes).map(floats);
        finals.slots.iter().copied().zip(rows).collect()
    }

    pub fn rewards(&self) -> Vec<f32> {
        let policy = &self.batch.layout().policies[0];
        floats(&self.batch.bytes()[policy.reward.rows(0..policy.num_agents)])
    }

    /// Returns terminated, truncated and active of every slot of the first policy.
    pub fn flags(&self) -> [Vec<u8>; 3] {
        let policy = &self.batch.layout().policies[0];
        [policy.terminated, policy.truncated, policy.active]
            .map(|array| self.batch.bytes()[array.rows(0..policy.num_agents)].to_vec())
    }

    /// Returns the masks of the first policy, one row per slot.
    pub fn masks(&self) -> Vec<Vec<u8>> {
        let policy = &self.batch.layout().policies[0];
        (0..policy.num_agents)
            .map(|slot| self.batch.bytes()[policy.mask.row(slot)].to_vec())
            .collect()
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|chunk| f32::from_le_bytes(*chunk))
        .collect()
}
