//! The order of things, and what the trainer and the game ask of each other.

use crate::game::*;
use crate::trainer::Session;
use bevy_app::prelude::*;
use bevy_app::{RunFixedMainLoop, RunFixedMainLoopSystems};
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_ludus::wire::{ErrorCode, FrameType, encode_frame};
use bevy_ludus::{Arguments, MethodResult, schedules};
use bevy_state::prelude::*;
use serde_json::{Value, json};

#[derive(Resource, Default)]
struct Diary(Vec<String>);

fn write_down(text: &'static str) -> impl Fn(ResMut<Diary>) {
    move |mut diary| diary.0.push(text.to_owned())
}

fn read_diary(_: In<Arguments>, mut diary: ResMut<Diary>) -> MethodResult {
    Ok(json!(std::mem::take(&mut diary.0)))
}

#[test]
fn sets_and_states_come_in_their_order() {
    let fill = |app: &mut App| {
        Game {
            plugin: LudusPlugin::default,
            ..Game::default()
        }
        .build(app);
        let after = RunFixedMainLoopSystems::AfterFixedMainLoop;
        app.init_resource::<Diary>()
            .add_ludus_method("read_diary", read_diary)
            .add_systems(
                First,
                write_down("exchanged").after(schedules::LudusSystems::Exchange),
            )
            .add_systems(Act, write_down("act"))
            .add_systems(FixedUpdate, write_down("tick"))
            .add_systems(Judge, write_down("judge"))
            .add_systems(Observe, write_down("observe"))
            .add_systems(Reset, write_down("reset"))
            .add_systems(
                RunFixedMainLoop,
                write_down("observed")
                    .in_set(after)
                    .after(schedules::LudusSystems::Observe)
                    .before(schedules::LudusSystems::Reset),
            )
            .add_systems(OnEnter(ControlState::Running), write_down("Running"))
            .add_systems(
                OnEnter(ControlState::PausedForControl),
                write_down("Paused"),
            )
            .add_systems(OnEnter(ControlState::Reset), write_down("Reset"))
            .add_systems(Update, write_down("update"));
    };
    let mut session = Session::open(fill, &json!({"ticks_per_step": 2}));
    let diary = |session: &mut Session| {
        session
            .trainer
            .call(json!({"world": 0}), "read_diary", json!([]))["value"]
            .clone()
    };
    diary(&mut session);
    session.reset(&seeds(0, 1), Value::Null);
    assert_eq!(
        diary(&mut session),
        json!(["Reset", "reset", "observe", "Paused"])
    );
    session.step(0);
    let step = json!([
        "exchanged",
        "Running",
        "act",
        "tick",
        "tick",
        "judge",
        "observe",
        "observed",
        "update",
        "Paused"
    ]);
    assert_eq!(diary(&mut session), step);
    session.step(i64::from(END));
    let end = json!([
        "exchanged",
        "Running",
        "act",
        "tick",
        "tick",
        "judge",
        "observe",
        "observed",
        "Reset",
        "reset",
        "observe",
        "update",
        "Paused"
    ]);
    assert_eq!(diary(&mut session), end);
    assert_eq!(session.trainer.close(), AppExit::Success);
}

fn tell_wind(In(arguments): In<Arguments>, counters: Query<&Counter>) -> MethodResult {
    let agent = arguments.agent.ok_or("name an agent")?;
    let counter = counters.get(agent).map_err(|error| error.to_string())?;
    Ok(json!([counter.wind, arguments.values]))
}

#[test]
fn methods_are_called_and_requests_are_fetched() {
    for layout in ["grid", "isolated"] {
        let fill = |app: &mut App| {
            let fill = |app: &mut App| {
                Game::default().fill(app);
                app.add_ludus_method("tell_wind", tell_wind).add_systems(
                    FixedUpdate,
                    |mut requests: ResMut<Requests>| {
                        requests.save_checkpoint();
                    },
                );
            };
            fill(app);
            app.add_plugins(LudusPlugin::default().isolated_by(fill));
        };
        let mut session = Session::open(fill, &json!({"num_worlds": 2, "layout": layout}));
        session.reset(&seeds(0, 2), json!([{"wind": 1.5}, {"wind": 2.5}]));
        let target = json!({"world": 1, "agent": "hero"});
        let result = session.trainer.call(target, "tell_wind", json!([7]));
        assert_eq!(result["value"], json!([2.5, [7]]));
        let mut error = |target: Value, method: &str| {
            let result = session.trainer.call(target, method, json!([]));
            result["error"].as_str().expect("an error").to_owned()
        };
        assert!(error(json!({"world": 2}), "tell_wind").contains("no world 2"));
        assert!(error(json!({"world": 0}), "fly").contains("no method fly"));
        let nobody = error(json!({"world": 1, "agent": "nobody"}), "tell_wind");
        assert_eq!(nobody, "there is no agent nobody in world 1", "{layout}");
        assert!(error(json!({"world": 0}), "tell_wind").contains("name an agent"));
        assert!(error(json!({"bridge": true}), "fly").contains("no method fly"));
        assert_eq!(session.step(0).flags, 2, "there are requests");
        let bridge = json!({"bridge": true});
        let taken = session
            .trainer
            .call(bridge.clone(), "take_requests", json!([]));
        assert_eq!(taken["value"], json!([{"kind": "save"}]));
        let status = json!([{"agent_steps": 5, "updates": 1, "policies": {}}]);
        let shown = session.trainer.call(bridge, "show_status", status);
        assert_eq!(shown["value"], Value::Null);
        assert_eq!(session.trainer.close(), AppExit::Success);
    }
}

fn report_wind(counters: Query<(&Counter, &InWorld)>, mut worlds: Query<&mut LudusWorld>) {
    for (counter, home) in &counters {
        let mut world = worlds.get_mut(home.0).expect("its world");
        world.report_metric("ticks", counter.ticks);
        match counter.wind {
            -1.0 => world.report_metric("bad", f32::NAN),
            -2.0 => (0..64).for_each(|n| world.report_metric(&format!("metric {n}"), n)),
            _ => {}
        }
    }
}

fn reporting(layout: &str) -> Session {
    let fill = |app: &mut App| {
        let fill = |app: &mut App| {
            Game::default().fill(app);
            app.add_systems(Judge, report_wind);
        };
        fill(app);
        app.add_plugins(LudusPlugin::default().isolated_by(fill));
    };
    Session::open(
        fill,
        &json!({"num_worlds": 2, "first_world": 4, "layout": layout}),
    )
}

#[test]
fn metrics_of_all_worlds_are_fetched_once() {
    for layout in ["grid", "isolated"] {
        let mut session = reporting(layout);
        session.reset(&seeds(0, 2), Value::Null);
        for _ in 0..3 {
            assert_eq!(session.step(0).flags, 0, "they set no flag");
        }
        session.reset(&seeds(7, 2), Value::Null);
        session.step(0);
        let mut take = || {
            let bridge = json!({"bridge": true});
            session.trainer.call(bridge, "take_requests", json!([]))["value"].clone()
        };
        // One tick a step: 1, 2 and 3, and 1 after all worlds were rebuilt.
        let ticks = json!({"count": 8, "sum": 14.0, "min": 1.0, "max": 3.0});
        let expected = json!([{"kind": "metrics", "metrics": {"ticks": ticks}}]);
        assert_eq!(take(), expected, "{layout}");
        assert_eq!(take(), json!([]));
        assert_eq!(session.trainer.close(), AppExit::Success);
    }
}

#[test]
fn a_report_that_cannot_be_names_the_world() {
    for layout in ["grid", "isolated"] {
        for (wind, expected) in [
            (-1.0, "): metric bad is NaN, expected a finite number"),
            (
                -2.0,
                "): metric metric 63 is one more than the 64 that there may be",
            ),
        ] {
            let mut session = reporting(layout);
            session.reset(&seeds(0, 2), json!([{}, {"wind": wind}]));
            let frame = encode_frame(FrameType::Step, session.actions.payload()).unwrap();
            session.trainer.send(&frame);
            let report = session.trainer.refusal();
            assert_eq!(report.code, ErrorCode::Game);
            let message = report.message;
            assert!(message.starts_with("world 1 (entity "), "{message}");
            assert!(message.ends_with(expected), "{message}");
            assert_ne!(session.trainer.end(), AppExit::Success);
        }
    }
}

#[test]
fn the_ceiling_is_measured_and_needs_a_reset_after() {
    for layout in ["grid", "isolated"] {
        let mut session = divisible().open(&json!({"num_worlds": 3, "layout": layout}));
        let bridge = json!({"bridge": true});
        let result = session.trainer.call(bridge, "run_ceiling", json!([50, 1]));
        assert_eq!(result["value"]["num_steps"], 50);
        assert!(result["value"]["elapsed_us"].as_u64() > Some(0));
        session.reset(&seeds(0, 3), Value::Null);
        assert_eq!(session.step(0).tick, 51 * 3);
        assert_eq!(session.seen(0)[2][0], 3.0);
        let bridge = json!({"bridge": true});
        session.trainer.call(bridge, "run_ceiling", json!([1, 1]));
        session
            .trainer
            .send(&encode_frame(FrameType::Step, session.actions.payload()).unwrap());
        assert_eq!(session.trainer.refusal().code, ErrorCode::Sequence);
        assert_ne!(session.trainer.end(), AppExit::Success);
    }
}

#[test]
fn pings_are_answered_and_silence_is_an_end() {
    let mut session = Game::default().open(&worlds(1));
    session
        .trainer
        .send(&encode_frame(FrameType::Ping, b"still there?").unwrap());
    assert_eq!(session.trainer.receive(FrameType::Pong), b"still there?");
    assert_eq!(
        session.trainer.end(),
        AppExit::Success,
        "the trainer has gone"
    );
    let mut session = Game::default().open(&json!({"idle_timeout_s": 1, "spin_us": 1000}));
    let report = session.trainer.refusal();
    assert_eq!(report.code, ErrorCode::Timeout);
    assert_ne!(session.trainer.end(), AppExit::Success);
}

#[test]
fn without_a_trainer_one_world_plays() {
    let mut app = App::new();
    Game::default().build(&mut app);
    app.insert_resource(bevy_time::TimeUpdateStrategy::FixedTimesteps(1))
        .finish();
    for _ in 0..40 {
        app.update();
    }
    let mut counters = app.world_mut().query::<(&Counter, &Episode)>();
    let (counter, episode) = counters.single(app.world()).expect("one agent");
    // An episode is 10 steps of 3 ticks; a step is judged when the next one begins.
    assert!(
        (1.0..=30.0).contains(&counter.ticks) && episode.is_playing(),
        "{episode:?}"
    );
    assert_eq!(episode.steps(), (counter.ticks as u32).div_ceil(3) - 1);
}
