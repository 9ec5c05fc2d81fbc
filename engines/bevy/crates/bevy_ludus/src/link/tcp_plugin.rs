//! The plugin that connects the app with a trainer.

use super::command_line::TOKEN_VARIABLE;
use super::{Address, CommandLine, LinkError, watch_parent};
use crate::error::print_error;
use crate::model::answer_parity;
use bevy_app::{App, AppExit, Plugin, PluginsState};
use bevy_ecs::prelude::*;
use std::path::PathBuf;

/// What a game answers to `--ludus-about`. `ludus train path/to/executable` looks for these bytes in
/// the file, so that it knows how to start the game.
const SIGNATURE: &str = "This game is made with bevy_ludus and speaks the Ludus protocol.";

/// Connects to the trainer that the command line names (`--ludus-connect=…`), or listens for one
/// (`--ludus-listen=…`).
///
/// With a trainer it also takes over the app's runner: updates follow each other as fast as the
/// trainer asks for them; so does `--ludus-headless` without one, as fast as the machine can. Otherwise
/// it does nothing.
#[derive(Clone, Debug, Default)]
pub struct LudusTcpPlugin {
    connect_to: Vec<Address>,
    listen_at: Option<Address>,
    token: Option<String>,
    has_own_runner: bool,
}

/// Where the first update of the app connects to.
#[derive(Resource, Debug)]
pub(crate) struct PendingLink(pub CommandLine);

impl LudusTcpPlugin {
    /// Connects to an address if the command line names none.
    ///
    /// # Errors
    /// The text is not an address.
    pub fn connect_to(mut self, address: &str) -> Result<Self, super::AddressError> {
        self.connect_to.push(address.parse()?);
        Ok(self)
    }

    /// Listens at an address if the command line names none. Other machines need a token.
    ///
    /// # Errors
    /// The text is not an address.
    pub fn listen_at(mut self, address: &str) -> Result<Self, super::AddressError> {
        self.listen_at = Some(address.parse()?);
        Ok(self)
    }

    /// Sets the secret shared with a trainer on another machine, at least 16 characters, if neither the
    /// command line nor the trainer that starts the game does.
    #[must_use]
    pub fn token(mut self, token: impl Into<String>) -> Self {
        self.token = Some(token.into());
        self
    }

    /// Leaves the app its own runner in training, such as the loop of a window.
    #[must_use]
    pub fn keep_runner(mut self) -> Self {
        self.has_own_runner = true;
        self
    }

    fn complete(&self, mut read: CommandLine) -> CommandLine {
        if !read.has_trainer() {
            read.connect_to.clone_from(&self.connect_to);
            read.listen_at.clone_from(&self.listen_at);
        }
        if read.token.is_empty() {
            read.token = std::env::var(TOKEN_VARIABLE).unwrap_or_default();
        }
        if let (true, Some(token)) = (read.token.is_empty(), &self.token) {
            read.token.clone_from(token);
        }
        read
    }
}

impl Plugin for LudusTcpPlugin {
    fn build(&self, app: &mut App) {
        match CommandLine::read(std::env::args().skip(1)) {
            Ok(read) if read.about => print_signature(app),
            Ok(CommandLine {
                parity: Some(folder),
                ..
            }) => answer(app, folder),
            Ok(read) => {
                let complete = self.complete(read);
                watch_parent(complete.parent_pid);
                if complete.is_uncapped() && !self.has_own_runner {
                    app.set_runner(run_uncapped);
                }
                app.insert_resource(PendingLink(complete));
            }
            Err(error) => refuse(app, error),
        }
    }
}

/// Lets the app end with an error before it begins.
fn refuse(app: &mut App, error: LinkError) {
    app.set_runner(move |_| {
        print_error(&error, "");
        AppExit::error()
    });
}

/// Lets the app say what it is and end.
#[allow(clippy::print_stdout)]
fn print_signature(app: &mut App) {
    app.set_runner(|_| {
        println!("{SIGNATURE}");
        AppExit::Success
    });
}

/// Lets the app answer a parity test and end.
fn answer(app: &mut App, folder: PathBuf) {
    app.set_runner(move |_| match answer_parity(&folder) {
        Ok(()) => AppExit::Success,
        Err(error) => {
            print_error(&error, "");
            AppExit::error()
        }
    });
}

/// Returns whether the command line asks for no window: a trainer plays the game as fast as it can,
/// or `--ludus-headless` is there.
#[must_use]
pub fn is_headless() -> bool {
    CommandLine::read(std::env::args().skip(1)).is_ok_and(|read| read.has_no_window())
}

/// Returns whether the command line names a trainer.
#[must_use]
pub fn is_trained() -> bool {
    CommandLine::read(std::env::args().skip(1)).is_ok_and(|read| read.has_trainer())
}

/// Updates the app without any pause, until it exits.
fn run_uncapped(mut app: App) -> AppExit {
    while app.plugins_state() == PluginsState::Adding {
        bevy_tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    loop {
        app.update();
        if let Some(exit) = app.should_exit() {
            return exit;
        }
    }
}
