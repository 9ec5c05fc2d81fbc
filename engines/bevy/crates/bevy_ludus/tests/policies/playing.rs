//! Games that play with policies from files, without a trainer.

use crate::files::{bytes, chooser, tensor};
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::TimeUpdateStrategy;
use serde_json::{Value, json};

/// Steps of the episode so far, and 1.
#[derive(ObservationSpace)]
struct Seen {
    observation: [f32; 2],
}

#[derive(ActionSpace, Clone, Copy)]
struct Choice {
    #[ludus(n = 3)]
    choice: u8,
}

/// What an agent did in every tick since the beginning.
#[derive(Component, Default)]
struct Done(Vec<u8>);

/// Steps of the episode.
#[derive(Component, Default)]
struct Steps(u8);

/// All episodes that have ended.
#[derive(Resource, Default)]
struct Ended(Vec<EpisodeEnded>);

const TICKS: u32 = 2;
const STEPS: u32 = 5;

/// A game of one agent that a policy plays, and of one that the game plays.
fn game(policies: LudusPolicyPlugin, hero: Policy) -> App {
    let mut app = App::new();
    app.add_policy::<Seen, Choice>(hero.max_episode_steps(STEPS))
        .add_policy::<Seen, Choice>(Policy::new("other"))
        .add_plugins(LudusPlugin::default().ticks_per_step(TICKS))
        .add_plugins(policies)
        .init_resource::<Ended>()
        .add_observer(fill_world)
        .add_systems(FixedUpdate, note)
        .add_systems(Judge, judge)
        .add_systems(Reset, begin)
        .add_systems(Observe, observe)
        .add_systems(Update, hear)
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    app
}

fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    let home = InWorld(add.entity);
    commands.spawn((Agent::of("hero"), home, Done::default(), Steps::default()));
    let choice = Action(Choice { choice: 2 });
    commands.spawn((Agent::of("other"), home, Done::default(), choice));
}

fn judge(mut agents: Query<(&mut Reward, &mut Steps)>) {
    for (mut reward, mut steps) in &mut agents {
        reward.0 = 0.5;
        steps.0 += 1;
    }
}

fn begin(mut agents: Query<(&Episode, &mut Steps)>) {
    for (episode, mut steps) in &mut agents {
        if episode.is_beginning() {
            steps.0 = 0;
        }
    }
}

fn note(mut agents: Query<(&Action<Choice>, &mut Done)>) {
    for (action, mut done) in &mut agents {
        done.0.push(action.0.choice);
    }
}

fn observe(mut agents: Query<(&Steps, &mut Observation<Seen>)>) {
    for (steps, mut seen) in &mut agents {
        seen.0.observation = [f32::from(steps.0), 1.0];
    }
}

fn hear(mut messages: MessageReader<EpisodeEnded>, mut ended: ResMut<Ended>) {
    ended.0.extend(messages.read().cloned());
}

/// Plays some ticks and returns what the agents did in each: the hero and the other one.
fn play(app: &mut App, num_ticks: usize) -> [Vec<u8>; 2] {
    // In its first update an app only takes the time.
    for _ in 0..=num_ticks {
        app.update();
    }
    assert_eq!(app.should_exit(), None);
    let mut agents = app.world_mut().query::<(&Agent, &Done)>();
    ["hero", "other"].map(|name| {
        let done = agents
            .iter(app.world())
            .find(|(agent, _)| agent.policy == name);
        done.expect("the agent").1.0.clone()
    })
}

fn playing(policy: &Value) -> LudusPolicyPlugin {
    LudusPolicyPlugin::default().policy_bytes("hero", bytes(policy))
}

/// Chooses 0 in the first two steps of an episode, then 1.
fn two_then_one() -> Value {
    chooser(2, &[0.0, 1.5, 1.0, 0.0, 0.0, -9.0], &[0.0; 3])
}

/// Repeats the choices of one episode, tick by tick.
fn ticks(choices: &[u8], count: usize) -> Vec<u8> {
    let of_episode = choices.iter().flat_map(|choice| [*choice; TICKS as usize]);
    of_episode.cycle().take(count).collect()
}

#[test]
fn a_policy_decides_by_what_is_seen_and_every_step_has_its_ticks() {
    let mut app = game(playing(&two_then_one()), Policy::new("hero"));
    let [hero, other] = play(&mut app, 24);
    assert_eq!(hero, ticks(&[0, 0, 1, 1, 1], 24));
    assert_eq!(
        other, [2; 24],
        "agents without a policy keep their own actions"
    );
}

#[test]
fn episodes_that_end_are_told() {
    let mut app = game(playing(&two_then_one()), Policy::new("hero"));
    play(&mut app, 24);
    let ended = &app.world().resource::<Ended>().0;
    assert_eq!(ended.len(), 2);
    for one in ended {
        assert_eq!((one.policy.as_str(), one.num_steps), ("hero", STEPS));
        assert_eq!(one.episode_return, 0.5 * f64::from(STEPS));
        assert!(one.agent.is_some());
    }
}

/// A memory that rises towards 1 by half of what is missing, and a choice that looks at nothing else.
fn remembering() -> Value {
    let mut policy = chooser(1, &[0.0, 1.0, 0.0], &[0.8, 0.0, -9.0]);
    policy["observation"][0]["shape"] = json!([2]);
    let (far, zeros) = (20.0, [0.0; 6]);
    policy["memory"] = json!({
        "kind": "gru", "weight_input": tensor(&[3, 2], &zeros),
        "weight_hidden": tensor(&[3, 1], &zeros[..3]),
        "bias_input": tensor(&[3], &[0.0, 0.0, far]), "bias_hidden": tensor(&[3], &zeros[..3]),
    });
    policy
}

#[test]
fn memory_is_empty_when_an_episode_begins() {
    let mut app = game(playing(&remembering()), Policy::new("hero"));
    let [hero, _] = play(&mut app, 24);
    // The memory is 0.5, 0.75, 0.875 in the first three steps.
    assert_eq!(hero, ticks(&[0, 0, 1, 1, 1], 24));
}

fn forbid(mut masks: Query<(&Steps, &mut ActionMask)>) {
    for (steps, mut mask) in &mut masks {
        mask.0 = match steps.0 {
            0 => vec![0, 1, 1],
            1 => vec![1, 1, 0],
            2 => vec![0, 0, 0],
            _ => vec![1, 1, 1],
        };
    }
}

#[test]
fn forbidden_choices_are_not_taken() {
    let mut policy = chooser(2, &[0.0; 6], &[0.0, 2.0, 3.0]);
    policy["has_action_mask"] = json!(true);
    let mut app = game(playing(&policy), Policy::new("hero").with_action_mask());
    app.add_systems(Observe, forbid);
    assert_eq!(play(&mut app, 20)[0], ticks(&[2, 1, 0, 2, 2], 20));
}

#[test]
fn a_wrong_mask_ends_the_game() {
    let mut policy = two_then_one();
    policy["has_action_mask"] = json!(true);
    let mut app = game(playing(&policy), Policy::new("hero").with_action_mask());
    let wrong = |mut masks: Query<(&Steps, &mut ActionMask)>| {
        for (steps, mut mask) in &mut masks {
            mask.0.truncate(3 - usize::from(steps.0));
        }
    };
    app.add_systems(Observe, wrong);
    for _ in 0..4 {
        app.update();
    }
    assert_eq!(app.should_exit(), Some(AppExit::error()));
}

#[test]
fn drawn_actions_depend_on_the_seed_only() {
    let drawn = |seed| {
        let policy = chooser(2, &[0.0; 6], &[0.0, 0.0, -30.0]);
        let policies = playing(&policy).sampling().seed(seed);
        play(&mut game(policies, Policy::new("hero")), 80)[0].clone()
    };
    let first = drawn(3);
    assert!(first.contains(&0) && first.contains(&1) && !first.contains(&2));
    assert_eq!(drawn(3), first);
    assert_ne!(drawn(4), first);
}

#[test]
fn policies_that_cannot_be_played_end_the_game() {
    let wide = bytes(&chooser(3, &[0.0; 9], &[0.0; 3]));
    for policies in [
        LudusPolicyPlugin::default().policy_bytes("hero", wide),
        LudusPolicyPlugin::default().policy_bytes("hero", &b"{}"[..]),
        LudusPolicyPlugin::default().policy("hero", "/no/such/file"),
        playing(&two_then_one()).policy("villain", "villain.ludus.json"),
    ] {
        let mut app = game(policies, Policy::new("hero"));
        app.update();
        assert_eq!(app.should_exit(), Some(AppExit::error()));
    }
}
