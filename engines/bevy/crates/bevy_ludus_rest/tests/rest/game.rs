//! An environment as users of bevy_rl write it: agents that count.

use crate::client::Client;
use bevy_app::prelude::*;
use bevy_app::{PluginsState, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_ludus_rest::*;
use bevy_state::prelude::*;
use bevy_time::{Time, TimePlugin};
use serde::Serialize;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const NUM_AGENTS: usize = 2;
const DEADLINE: Duration = Duration::from_secs(20);

pub type Gym = AIGymState<String, Counts>;

/// What clients see.
#[derive(Clone, Debug, Default, PartialEq, Resource, Serialize)]
pub struct Counts {
    pub numbers: [i64; NUM_AGENTS],
    /// Updates in which the game ran.
    pub num_ran: u64,
    /// Of the game's clock.
    pub milliseconds: u128,
    pub num_steps: u64,
}

/// What a test wants to be different.
#[derive(Clone, Copy, Debug, Default, PartialEq, Resource)]
pub struct Habits {
    /// Calls neither `send_step_result` nor `reset`.
    pub is_silent: bool,
    /// Reports in startup that it is loading, and is ready after this many updates.
    pub num_loading: u64,
    /// Answers steps without ever running.
    pub stays_paused: bool,
}

/// A game that runs on a thread of its own until it is dropped.
pub struct Game {
    pub address: SocketAddr,
    pub num_updates: Arc<AtomicU64>,
    num_begun: Arc<AtomicU64>,
    is_ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<AppExit>>,
}

pub fn settings() -> AIGymSettings {
    AIGymSettings {
        num_agents: NUM_AGENTS as u32,
        port: 0,
        timeout: 10.0,
        ..Default::default()
    }
}

#[derive(Resource)]
struct Handles {
    num_updates: Arc<AtomicU64>,
    num_begun: Arc<AtomicU64>,
    is_ending: Arc<AtomicBool>,
}

impl Game {
    pub fn start(settings: AIGymSettings, habits: Habits) -> Self {
        let (sender, receiver) = channel();
        let num_updates = Arc::new(AtomicU64::new(0));
        let num_begun = Arc::new(AtomicU64::new(0));
        let is_ending = Arc::new(AtomicBool::new(false));
        let handles = Handles {
            num_updates: Arc::clone(&num_updates),
            num_begun: Arc::clone(&num_begun),
            is_ending: Arc::clone(&is_ending),
        };
        let thread = std::thread::spawn(move || {
            let mut app = make_app(settings, habits);
            app.insert_resource(handles)
                .add_systems(Last, look_at_handles);
            run(app, |app| {
                let _ = sender.send(app.world().resource::<RestServer>().address());
            })
        });
        let address = receiver.recv_timeout(DEADLINE).unwrap();
        Self {
            address,
            num_updates,
            num_begun,
            is_ending,
            thread: Some(thread),
        }
    }

    pub fn client(&self) -> Client {
        Client::connect(self.address)
    }

    /// Waits until this many steps have begun.
    pub fn await_begun(&self, count: u64) {
        let deadline = Instant::now() + DEADLINE;
        while self.num_begun.load(Ordering::Relaxed) < count {
            assert!(Instant::now() < deadline, "step {count} does not begin");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Lets the game end as games do, and returns how.
    pub fn end(&mut self) -> AppExit {
        self.is_ending.store(true, Ordering::Relaxed);
        let thread = self.thread.take().unwrap();
        let deadline = Instant::now() + DEADLINE;
        while !thread.is_finished() {
            assert!(Instant::now() < deadline, "the game does not end");
            std::thread::sleep(Duration::from_millis(1));
        }
        thread.join().unwrap()
    }
}

impl Drop for Game {
    fn drop(&mut self) {
        if self.thread.is_some() && !std::thread::panicking() {
            assert_eq!(self.end(), AppExit::Success);
        }
    }
}

/// Updates an app until it exits; calls back after the first update.
pub fn run(app: App, began: impl FnOnce(&App)) -> AppExit {
    run_until(app, began, || false)
}

/// Updates an app until it exits, or until it is to end.
fn run_until(mut app: App, began: impl FnOnce(&App), is_ending: impl Fn() -> bool) -> AppExit {
    while app.plugins_state() == PluginsState::Adding {
        std::thread::yield_now();
    }
    app.finish();
    app.cleanup();
    app.update();
    began(&app);
    loop {
        match app.should_exit() {
            Some(exit) => return exit,
            None if is_ending() => return AppExit::Success,
            None => app.update(),
        }
    }
}

/// Any app, on a thread of its own until this is dropped.
pub struct Running {
    pub address: SocketAddr,
    is_ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<AppExit>>,
}

impl Running {
    pub fn start(fill: impl FnOnce(&mut App) + Send + 'static) -> Self {
        let (sender, receiver) = channel();
        let is_ending = Arc::new(AtomicBool::new(false));
        let ending = Arc::clone(&is_ending);
        let thread = std::thread::spawn(move || {
            let mut app = App::new();
            fill(&mut app);
            let send_address = |app: &App| {
                let _ = sender.send(app.world().resource::<RestServer>().address());
            };
            run_until(app, send_address, || ending.load(Ordering::Relaxed))
        });
        Self {
            address: receiver.recv_timeout(DEADLINE).unwrap(),
            is_ending,
            thread: Some(thread),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.is_ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

pub fn make_app(settings: AIGymSettings, habits: Habits) -> App {
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), TimePlugin))
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<String, Counts>::default())
        .init_resource::<Counts>()
        .insert_resource(habits)
        .add_systems(Startup, load.run_if(resource_equals_loading))
        .add_systems(
            Update,
            (
                finish_loading,
                tick.run_if(in_state(SimulationState::Running)),
            ),
        )
        // In no order, as users write it.
        .add_systems(Update, (on_pause, on_control, on_reset));
    app
}

fn resource_equals_loading(habits: Res<Habits>) -> bool {
    habits.num_loading > 0
}

fn load(mut state: ResMut<NextState<SimulationState>>) {
    state.set(SimulationState::Initializing);
}

fn finish_loading(
    habits: Res<Habits>,
    mut num_updates: Local<u64>,
    state: Res<State<SimulationState>>,
    mut next: ResMut<NextState<SimulationState>>,
) {
    *num_updates += 1;
    let is_loading = *state.get() == SimulationState::Initializing;
    if is_loading && habits.num_loading > 0 && *num_updates > habits.num_loading {
        next.set(SimulationState::Running);
    }
}

fn look_at_handles(handles: Res<Handles>, mut exits: MessageWriter<AppExit>) {
    handles.num_updates.fetch_add(1, Ordering::Relaxed);
    if handles.is_ending.load(Ordering::Relaxed) {
        exits.write(AppExit::Success);
    }
}

fn tick(time: Res<Time>, mut counts: ResMut<Counts>) {
    counts.num_ran += 1;
    counts.milliseconds += time.delta().as_millis();
}

fn on_pause(
    mut pauses: EventReader<EventPause>,
    counts: Res<Counts>,
    habits: Res<Habits>,
    gym: Res<Gym>,
) {
    for _ in pauses.read() {
        let mut gym = gym.lock().unwrap();
        publish(&mut gym, &counts);
        if !habits.is_silent {
            gym.send_step_result(vec![true; NUM_AGENTS]);
        }
    }
}

fn publish(gym: &mut AIGymStateInner<String, Counts>, counts: &Counts) {
    gym.set_env_state(counts.clone());
    for (agent, number) in counts.numbers.iter().enumerate() {
        gym.set_reward(agent, *number as f32 / 2.0);
        gym.set_terminated(agent, *number > 9);
    }
}

fn on_control(
    mut controls: EventReader<EventControl>,
    mut counts: ResMut<Counts>,
    habits: Res<Habits>,
    gym: Res<Gym>,
    mut next: ResMut<NextState<SimulationState>>,
    handles: Option<Res<Handles>>,
) {
    for EventControl(actions) in controls.read() {
        if let Some(handles) = &handles {
            handles.num_begun.fetch_add(1, Ordering::Relaxed);
        }
        counts.num_steps += 1;
        for (agent, action) in actions.iter().enumerate() {
            let action = action.as_deref().unwrap_or_default();
            counts.numbers[agent] += obey(action, &gym);
        }
        let is_loading = actions.iter().flatten().any(|action| action == "load");
        if habits.stays_paused {
            let mut gym = gym.lock().unwrap();
            publish(&mut gym, &counts);
            gym.send_step_result(vec![]);
        } else if is_loading {
            next.set(SimulationState::Initializing);
        } else {
            next.set(SimulationState::Running);
        }
    }
}

/// Returns how much an action adds.
fn obey(action: &str, gym: &Gym) -> i64 {
    match action.split_once(' ') {
        Some(("sleep", milliseconds)) => {
            std::thread::sleep(Duration::from_millis(milliseconds.parse().unwrap()));
        }
        Some(("reward", agent)) => {
            gym.lock().unwrap().set_reward(agent.parse().unwrap(), 1.0);
        }
        _ => return action.parse().unwrap_or(0),
    }
    0
}

fn on_reset(
    mut resets: EventReader<EventReset>,
    mut counts: ResMut<Counts>,
    habits: Res<Habits>,
    gym: Res<Gym>,
    mut next: ResMut<NextState<SimulationState>>,
) {
    for _ in resets.read() {
        counts.numbers = [0; NUM_AGENTS];
        if !habits.is_silent {
            gym.lock().unwrap().reset();
        }
        next.set(SimulationState::Running);
    }
}
