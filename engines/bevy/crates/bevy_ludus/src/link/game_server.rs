//! Waiting for a trainer: all clients are greeted at the same time, and the first that proves itself
//! is accepted.

use super::greeting::{Greeting, MIN_TOKEN_LENGTH};
use super::stream::{Listener, Stream};
use super::{Address, CommandLine, Link, LinkError};
use crate::error::print_error;
use crate::training::Failure;
use crate::wire::{ConnectionState, ErrorCode, FrameReader, FrameType, encode_json};
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long a client may take to prove itself.
const GREETING_TIMEOUT: Duration = Duration::from_secs(10);
/// With one more, the oldest is dropped: a trainer proves itself at once.
const MAX_PENDING: usize = 64;
const MAX_GREETING_BYTES: usize = 1 << 16;
/// How much of an unproven client's text is printed, characters.
const MAX_SHOWN: usize = 200;
const POLL: Duration = Duration::from_millis(5);

/// A client that has yet to prove itself.
struct PendingConnection {
    stream: Stream,
    greeting: Greeting,
    reader: FrameReader,
    deadline: Instant,
}

/// Listens until a trainer has proved itself; others are dropped.
pub(super) fn listen(
    address: &Address,
    command_line: &CommandLine,
    timeout: Duration,
) -> Result<Link, Failure> {
    let is_local = address.is_local();
    if !is_local && command_line.token.chars().count() < MIN_TOKEN_LENGTH {
        let text = "a game that other machines can reach needs a token of 16 characters";
        let hint = "write it into a file and name it on both sides (--ludus-token-file)";
        return Err(Failure::new(ErrorCode::Token, text, hint));
    }
    let listener = Listener::bind(address).map_err(LinkError::Io)?;
    let deadline = Instant::now() + timeout;
    let mut pending = VecDeque::new();
    loop {
        while let Some(stream) = listener.accept().map_err(LinkError::Io)? {
            let token = command_line.token_for(is_local).map_err(Failure::from);
            match token.and_then(|token| PendingConnection::greet(stream, token)) {
                Ok(connection) => pending.extend(connection),
                // A trainer of this user writes the token before it connects.
                Err(failure) => print_error(&format!("dropped a client: {failure}"), ""),
            }
            if pending.len() > MAX_PENDING {
                pending.pop_front();
            }
        }
        for index in (0..pending.len()).rev() {
            match pending[index].advance() {
                Ok(None) => {}
                Ok(Some(state)) => {
                    let stream = pending.remove(index).map(|connection| connection.stream);
                    return stream.map_or(Err(LinkError::Closed.into()), |stream| {
                        stream.set_nonblocking(false).map_err(LinkError::Io)?;
                        Ok(Link::proven(stream, is_local, state))
                    });
                }
                Err(failure @ Failure::Trainer(_)) => return Err(failure),
                Err(failure) => {
                    if let Some(mut connection) = pending.remove(index) {
                        connection.reject(&failure);
                    }
                }
            }
        }
        if Instant::now() > deadline {
            return Err(LinkError::TimedOut(timeout).into());
        }
        sleep(POLL);
    }
}

impl PendingConnection {
    /// Sends the greeting; none if the client has gone.
    fn greet(mut stream: Stream, token: String) -> Result<Option<Self>, Failure> {
        let mut greeting = Greeting::new(token)?;
        let hello = greeting.hello()?;
        let is_sent = stream.write_all(&hello, GREETING_TIMEOUT).is_ok();
        let is_ready = is_sent && stream.set_nonblocking(true).is_ok();
        Ok(is_ready.then(|| Self {
            stream,
            greeting,
            reader: FrameReader::default(),
            deadline: Instant::now() + GREETING_TIMEOUT,
        }))
    }

    /// Reads what has come, and answers it. Returns the state once the trainer has proved itself.
    fn advance(&mut self) -> Result<Option<ConnectionState>, Failure> {
        if Instant::now() > self.deadline {
            return Err(LinkError::TimedOut(GREETING_TIMEOUT).into());
        }
        let mut bytes = [0; 4096];
        let count = match self.stream.read(&mut bytes) {
            Ok(0) => return Err(LinkError::Closed.into()),
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(LinkError::Io(error).into()),
        };
        let frames = self.reader.feed(&bytes[..count])?;
        if self.reader.num_pending_bytes() > MAX_GREETING_BYTES || frames.len() > 1 {
            let text = "more than an answer to the greeting came";
            return Err(Failure::new(ErrorCode::Frame, text, ""));
        }
        let Some(frame) = frames.first() else {
            return Ok(None);
        };
        if frame.kind == FrameType::Error
            && let Some(message) = self.greeting.unproven(&frame.payload)?
        {
            let said: String = message.chars().take(MAX_SHOWN).collect();
            let said = said.escape_debug();
            print_error(
                &format!("dropped a client: ERROR without the trainer's proof: {said}"),
                "",
            );
            return Err(LinkError::Closed.into());
        }
        let proof = self.greeting.prove(frame.kind, &frame.payload)?;
        self.stream
            .write_all(&proof, GREETING_TIMEOUT)
            .map_err(LinkError::Io)?;
        Ok(Some(self.greeting.state))
    }

    /// Sends the client the reason and drops it; a client that has gone misses the reason.
    fn reject(&mut self, failure: &Failure) {
        let Some(report) = failure.report() else {
            return;
        };
        print_error(&format!("dropped a client: {failure}"), "");
        if let Ok(frame) = encode_json(FrameType::Error, &report) {
            // An error means that the client has gone.
            let _ = self.stream.write_all(&frame, GREETING_TIMEOUT);
        }
    }
}
