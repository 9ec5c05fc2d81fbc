//! The connection to a trainer: TCP or a Unix socket, blocking, every wait with a deadline.

mod address;
mod busy_poller;
mod command_line;
mod game_server;
mod greeting;
mod stream;
mod tcp_plugin;
mod user_token;

pub use address::{Address, AddressError};
pub use command_line::CommandLine;
pub use tcp_plugin::{LudusTcpPlugin, is_headless, is_trained};

pub(crate) use greeting::greet;
pub(crate) use tcp_plugin::PendingLink;

use crate::training::Failure;
use crate::wire::{
    ConnectionState, EngineConfig, FrameType, HEADER_BYTES, MAX_SPIN_US, WireError, decode_header,
};
use busy_poller::BusyPoller;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use stream::Stream;
use thiserror::Error;

/// How long the trainer may take to answer the greeting, and a listening game waits for one.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// How long the rest of a frame that has begun may take.
const FRAME_TIMEOUT: Duration = Duration::from_secs(30);
const WATCH_INTERVAL: Duration = Duration::from_millis(200);
const FIRST_BUFFER_BYTES: usize = 1 << 16;

/// Why a connection has ended.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The trainer has closed the connection.
    #[error("the trainer closed the connection")]
    Closed,
    /// A deadline has passed.
    #[error("the trainer was silent for {} s", .0.as_secs())]
    TimedOut(Duration),
    /// The system reports an error.
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
    /// A header breaks the protocol.
    #[error("{0}")]
    Wire(#[from] WireError),
    /// No trainer answers.
    #[error("no trainer answers at {0}")]
    NoTrainer(String),
    /// The command line or the plugin names something that is not an address.
    #[error("{0}")]
    Address(#[from] AddressError),
    /// A file with a token cannot be read.
    #[error("the token file {path} cannot be read: {reason}")]
    TokenFile {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
}

/// A connection that carries whole frames.
#[derive(Debug)]
pub struct Link {
    stream: Stream,
    input: Vec<u8>,
    /// Bytes of `input` that have come.
    filled: usize,
    /// Length of the frame that was received last.
    frame_bytes: usize,
    idle_timeout: Duration,
    spin: Duration,
    poller: BusyPoller,
    /// Whether the other side is on this machine.
    pub is_local: bool,
    /// State of the conversation, if the other side has proved itself already.
    pub(crate) proven: Option<ConnectionState>,
}

/// Connects as the command line says, or listens until a trainer has proved itself.
pub(crate) fn connect(command_line: &CommandLine) -> Result<Link, Failure> {
    if let Some(address) = &command_line.listen_at {
        return game_server::listen(address, command_line, START_TIMEOUT);
    }
    for address in &command_line.connect_to {
        if let Ok(stream) = Stream::connect(address, START_TIMEOUT) {
            return Ok(Link::new(stream, address.is_local()));
        }
    }
    let tried: Vec<_> = command_line
        .connect_to
        .iter()
        .map(ToString::to_string)
        .collect();
    Err(LinkError::NoTrainer(tried.join(", ")).into())
}

/// Ends this process when the one that started it is gone, where the system shows processes as
/// files.
fn watch_parent(parent_pid: Option<u32>) {
    let Some(pid) = parent_pid else { return };
    let path = PathBuf::from(format!("/proc/{pid}"));
    if path.exists() {
        std::thread::spawn(move || {
            while path.exists() {
                std::thread::sleep(WATCH_INTERVAL);
            }
            std::process::exit(1);
        });
    }
}

impl Link {
    fn new(stream: Stream, is_local: bool) -> Self {
        Self {
            stream,
            input: vec![0; FIRST_BUFFER_BYTES],
            filled: 0,
            frame_bytes: 0,
            idle_timeout: START_TIMEOUT,
            spin: Duration::ZERO,
            poller: BusyPoller::default(),
            is_local,
            proven: None,
        }
    }

    /// Returns the link with one who has proved itself.
    fn proven(stream: Stream, is_local: bool, state: ConnectionState) -> Self {
        let mut link = Self::new(stream, is_local);
        link.proven = Some(state);
        link
    }

    /// Takes the trainer's deadlines.
    pub(crate) fn set_pace(&mut self, config: &EngineConfig) {
        self.idle_timeout = Duration::from_secs(config.idle_timeout_s.max(1));
        self.spin = Duration::from_micros(config.spin_us.min(MAX_SPIN_US));
    }

    /// Returns a second hand on the connection, to send a last word with.
    pub(crate) fn try_clone(&self) -> Result<Self, LinkError> {
        Ok(Self::new(self.stream.try_clone()?, self.is_local))
    }

    /// Sends a whole frame.
    ///
    /// # Errors
    /// The connection has ended, or the trainer does not take the frame within 30 seconds.
    pub fn send(&mut self, frame: &[u8]) -> Result<(), LinkError> {
        self.stream
            .write_all(frame, FRAME_TIMEOUT)
            .map_err(|error| match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut => LinkError::TimedOut(FRAME_TIMEOUT),
                ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => LinkError::Closed,
                _ => LinkError::Io(error),
            })
    }

    /// Waits for a frame and returns its type; its bytes are in [`Link::payload`].
    ///
    /// # Errors
    /// The connection has ended, a deadline has passed, or a header breaks the protocol.
    pub fn receive(&mut self) -> Result<FrameType, LinkError> {
        self.input.copy_within(self.frame_bytes..self.filled, 0);
        self.filled -= self.frame_bytes;
        self.frame_bytes = 0;
        while self.filled == 0 {
            self.read_some(self.idle_timeout, self.idle_timeout)?;
        }
        let began = Instant::now();
        self.fill(HEADER_BYTES, began)?;
        let mut header = [0; HEADER_BYTES];
        header.copy_from_slice(&self.input[..HEADER_BYTES]);
        let (kind, num_bytes) = decode_header(header)?;
        let end = HEADER_BYTES + num_bytes;
        if self.input.len() < end {
            self.input.resize(end, 0);
        }
        self.fill(end, began)?;
        self.frame_bytes = end;
        Ok(kind)
    }

    /// Returns the payload of the frame that was received last.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.input
            .get(HEADER_BYTES..self.frame_bytes)
            .unwrap_or_default()
    }

    /// Polls for data for a while and returns how many bytes have come; none if there were none, or
    /// somebody else needs the core. Waking up from sleep costs tens of microseconds, where a core
    /// is free for polling.
    fn spin_for_data(&mut self) -> io::Result<Option<usize>> {
        let mut now = Instant::now();
        if self.spin.is_zero() || self.poller.is_backing_off(now) {
            return Ok(None);
        }
        let end = now + self.spin;
        let mut was_away = false;
        self.stream.set_nonblocking(true)?;
        let mut result = Err(ErrorKind::WouldBlock.into());
        while now < end && has_no_data(&result) {
            let before = now;
            result = self.stream.read(&mut self.input[self.filled..]);
            now = Instant::now();
            was_away |= BusyPoller::was_away(before, now);
        }
        if was_away || has_no_data(&result) {
            self.poller.record_miss(now);
        }
        self.stream.set_nonblocking(false)?;
        match result {
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
            result => result.map(Some),
        }
    }

    /// Reads until this many bytes have come.
    fn fill(&mut self, num_bytes: usize, began: Instant) -> Result<(), LinkError> {
        while self.filled < num_bytes {
            let left = FRAME_TIMEOUT.saturating_sub(began.elapsed());
            self.read_some(left, FRAME_TIMEOUT)?;
        }
        Ok(())
    }

    /// Waits for some bytes. `whole` is the deadline that is told if it passes.
    fn read_some(&mut self, left: Duration, whole: Duration) -> Result<(), LinkError> {
        if left.is_zero() {
            return Err(LinkError::TimedOut(whole));
        }
        // Also for the rest of a frame: its first part is seen before the last is written.
        let count = match self.spin_for_data() {
            Ok(None) => {
                self.stream.set_read_timeout(left)?;
                self.stream.read(&mut self.input[self.filled..])
            }
            Ok(Some(count)) => Ok(count),
            Err(error) => Err(error),
        };
        match count {
            Ok(0) => Err(LinkError::Closed),
            Ok(count) => {
                self.filled += count;
                Ok(())
            }
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut => Err(LinkError::TimedOut(whole)),
                ErrorKind::Interrupted => Ok(()),
                ErrorKind::ConnectionReset => Err(LinkError::Closed),
                _ => Err(error.into()),
            },
        }
    }
}

fn has_no_data(result: &io::Result<usize>) -> bool {
    result
        .as_ref()
        .is_err_and(|error| error.kind() == ErrorKind::WouldBlock)
}
