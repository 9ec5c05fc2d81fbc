//! The queue between clients and game: one request waits, one is being worked on.

use super::error::Refusal;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot};

/// What a client wants of the game.
#[derive(Clone, Debug)]
pub(super) enum Ask {
    Step(Vec<Option<String>>),
    Reset,
    #[cfg_attr(not(feature = "camera"), allow(dead_code))]
    Picture,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Step,
    Reset,
    Picture,
}

impl Ask {
    fn kind(&self) -> Kind {
        match self {
            Self::Step(_) => Kind::Step,
            Self::Reset => Kind::Reset,
            Self::Picture => Kind::Picture,
        }
    }
}

#[derive(Debug)]
struct Waiting {
    ask: Ask,
    reply: oneshot::Sender<()>,
    deadline: Instant,
}

/// What the game works on. It is kept when its client has gone, as the game knows nothing of that.
#[derive(Debug)]
struct Current {
    /// What was asked, as long as a game that polls may still take it.
    ask: Option<Ask>,
    kind: Kind,
    reply: oneshot::Sender<()>,
    deadline: Instant,
    /// Whether the game has run since.
    has_run: bool,
    has_result: bool,
    /// Whole updates that the game has had for it.
    num_updates: u32,
    /// Whole updates since the result.
    num_updates_since: u32,
}

impl Current {
    fn new(waiting: Waiting, is_offered: bool) -> (Ask, Self) {
        let Waiting {
            ask,
            reply,
            deadline,
        } = waiting;
        let current = Self {
            ask: is_offered.then(|| ask.clone()),
            kind: ask.kind(),
            reply,
            deadline,
            has_run: false,
            has_result: false,
            num_updates: 0,
            num_updates_since: 0,
        };
        (ask, current)
    }

    /// Returns whether the game has surely done it: it took the request and gave a result, or ran.
    fn is_done(&self) -> bool {
        let has_played = self.has_run && self.kind != Kind::Picture;
        let has_answered = self.has_result && self.ask.is_none();
        has_played || has_answered || self.deadline <= Instant::now()
    }

    /// Returns whether the game has let an update pass without any sign that it read the event.
    fn is_unread(&self) -> bool {
        self.ask.is_some() && self.num_updates > 0 && !self.has_run && !self.has_result
    }
}

#[derive(Debug, Default)]
struct State {
    waiting: Option<Waiting>,
    current: Option<Current>,
    is_closed: bool,
    /// Whether the game has ever asked for requests itself.
    is_polled: bool,
    /// Whether it has done so in this update.
    is_polled_now: bool,
}

/// Passes requests to the game, and its answers back.
#[derive(Debug)]
pub(super) struct RequestQueue {
    state: Mutex<State>,
    /// Wakes a game that waits for clients: on its own, or while it serves them.
    came: Condvar,
    called: Notify,
    /// In lock-step an answer goes out when the game stands still again.
    is_lock_step: bool,
}

impl State {
    /// Returns the request that the game may begin with.
    fn next(&self) -> Option<&Ask> {
        let is_free = self
            .current
            .as_ref()
            .is_none_or(|current| current.deadline <= Instant::now());
        let waiting = self
            .waiting
            .as_ref()
            .filter(|waiting| !waiting.reply.is_closed());
        waiting.filter(|_| is_free).map(|waiting| &waiting.ask)
    }

    /// Returns the request that a game that polls may take.
    fn offered(&self) -> Option<&Ask> {
        let current = self.current.as_ref();
        current
            .and_then(|current| current.ask.as_ref())
            .or_else(|| self.next())
    }

    fn answer(&mut self) {
        if let Some(current) = self.current.take() {
            // The client may have gone.
            let _ = current.reply.send(());
        }
    }

    fn begin(&mut self, is_offered: bool) -> Option<Ask> {
        let (ask, current) = Current::new(self.waiting.take()?, is_offered);
        self.current = Some(current);
        Some(ask)
    }
}

impl RequestQueue {
    pub fn new(is_lock_step: bool) -> Self {
        Self {
            state: Mutex::default(),
            came: Condvar::new(),
            called: Notify::new(),
            is_lock_step,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a request; the receiver hears when the game has done it.
    ///
    /// # Errors
    /// The game has ended.
    pub fn submit(&self, ask: Ask, deadline: Instant) -> Result<oneshot::Receiver<()>, Refusal> {
        let (reply, answered) = oneshot::channel();
        let mut state = self.state();
        if state.is_closed {
            return Err(Refusal::ended());
        }
        // Clients take turns: a request that still waits has been given up by its client.
        state.waiting = Some(Waiting {
            ask,
            reply,
            deadline,
        });
        drop(state);
        self.came.notify_all();
        self.called.notify_one();
        Ok(answered)
    }

    /// Tells a game that polls whether a request of a kind waits for it.
    pub fn poll(&self, kind: Kind) -> bool {
        let mut state = self.state();
        state.is_polled = true;
        state.is_polled_now = true;
        state.offered().is_some_and(|ask| ask.kind() == kind)
    }

    /// Gives a game that polls the request of a kind, if there is one.
    pub fn receive(&self, kind: Kind) -> Option<Ask> {
        let mut state = self.state();
        state.is_polled = true;
        state.offered().filter(|ask| ask.kind() == kind)?;
        match &mut state.current {
            Some(current) if current.ask.is_some() => {
                // A result that came before was of what the game did until now.
                current.has_result = false;
                current.ask.take()
            }
            _ => state.begin(false),
        }
    }

    /// Takes the next request to pass it on as an event. A game that polls takes it itself, but for
    /// pictures.
    pub fn take_for_event(&self) -> Option<Ask> {
        let mut state = self.state();
        let kind = state.next()?.kind();
        if state.is_polled && kind != Kind::Picture {
            return None;
        }
        // It may be the first request of a game that polls, and does not read events.
        state.begin(kind != Kind::Picture)
    }

    /// Returns whether the game can do nothing but wait for a client.
    pub fn is_idle(&self) -> bool {
        let state = self.state();
        let is_at_rest = !state.is_polled || state.is_polled_now;
        is_at_rest && state.current.is_none() && state.next().is_none() && !state.is_closed
    }

    /// Returns whether the clock must go on though the game looks paused: it has states of its own,
    /// and works, or has not come to ask yet.
    pub fn needs_time(&self) -> bool {
        let state = self.state();
        match &state.current {
            Some(current) if current.kind == Kind::Picture => false,
            Some(current) => current.is_unread() || (state.is_polled && current.ask.is_none()),
            None => state.is_polled && !state.is_polled_now,
        }
    }

    /// Notes that the game runs.
    pub fn note_run(&self) {
        if let Some(current) = &mut self.state().current {
            current.has_run = true;
        }
    }

    /// Notes that the game says it has done what it was asked for. It means nothing if nobody asked.
    pub fn note_result(&self, kind: Kind) {
        let mut state = self.state();
        let Some(current) = state
            .current
            .as_mut()
            .filter(|current| current.kind == kind)
        else {
            return;
        };
        current.has_result = true;
        let is_certain = current.ask.is_none() || current.has_run;
        if is_certain && !self.is_lock_step {
            state.answer();
        }
    }

    /// At the beginning of an update in which the game stands still: answers what is done.
    pub fn finish(&self) {
        let mut state = self.state();
        let is_polled = state.is_polled;
        let Some(current) = &mut state.current else {
            return;
        };
        current.num_updates += 1;
        let mut is_done = current.is_done();
        if current.has_result && current.ask.is_some() {
            // A game that polls sends results before it has asked for the first request. One whole
            // update shows whether this one does.
            current.has_result = !is_polled;
            is_done |= current.has_result && current.num_updates_since > 0;
            current.num_updates_since += 1;
        }
        if is_done {
            state.answer();
        }
    }

    /// Notes that an update begins.
    pub fn begin_update(&self) {
        self.state().is_polled_now = false;
    }

    /// Resolves when a request waits.
    pub async fn arrival(&self) {
        while self.state().next().is_none() {
            self.called.notified().await;
        }
    }

    /// Blocks until a request waits, for some time.
    pub fn wait(&self, limit: Duration) {
        let state = self.state();
        let is_quiet = |state: &mut State| state.next().is_none() && !state.is_closed;
        drop(self.came.wait_timeout_while(state, limit, is_quiet));
    }

    /// Ends all that is under way: what has a result is answered, the rest is refused.
    pub fn close(&self) {
        let mut state = self.state();
        state.is_closed = true;
        state.waiting = None;
        if state
            .current
            .as_ref()
            .is_some_and(|current| current.has_result)
        {
            state.answer();
        }
        state.current = None;
    }
}
