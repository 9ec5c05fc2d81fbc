//! The HTTP server.

use super::answer::answer;
use super::connections::{Connection, Connections, WatchedStream};
use super::driver::RuntimeDriver;
use super::error::RestError;
use super::game_handle::GameHandle;
use bevy_ecs::resource::Resource;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use std::future::poll_fn;
use std::net::{Ipv4Addr, SocketAddr};
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Handle, Runtime};

/// How long the last answers may take when the app ends.
const CLOSING_TIME: Duration = Duration::from_millis(250);
const TICK: Duration = Duration::from_millis(1);

/// The server that clients of bevy_rl talk to. It ends with the app.
#[derive(Resource)]
pub struct RestServer {
    address: SocketAddr,
    game: Arc<GameHandle>,
    driver: Arc<RuntimeDriver>,
    /// None while it is dropped.
    runtime: Option<Arc<Runtime>>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for RestServer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("RestServer")
            .field("address", &self.address)
            .finish_non_exhaustive()
    }
}

impl RestServer {
    /// Returns where the server listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    pub(super) fn start(port: u16, game: GameHandle) -> Result<Self, RestError> {
        let runtime = Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build();
        let runtime = Arc::new(runtime.map_err(RestError::Start)?);
        let game = Arc::new(game);
        let (listener, address) = listen(port, &runtime)?;
        runtime.spawn(accept(listener, Arc::clone(&game)));
        let driver = Arc::new(RuntimeDriver::default());
        let thread = spawn_driver(Arc::clone(&driver), Arc::clone(&runtime), Arc::clone(&game))?;
        let (runtime, thread) = (Some(runtime), Some(thread));
        Ok(Self {
            address,
            game,
            driver,
            runtime,
            thread,
        })
    }

    /// Blocks until a request waits for the game, for some time.
    pub(super) fn wait(&self, limit: Duration) {
        match &self.runtime {
            // An app that runs inside a runtime of its own cannot drive another one.
            Some(runtime) if Handle::try_current().is_err() => {
                self.driver
                    .drive_until(runtime, limit, self.game.queue.arrival());
            }
            _ => self.game.queue.wait(limit),
        }
    }
}

impl Drop for RestServer {
    fn drop(&mut self) {
        self.game.queue.close();
        // The thread drops the runtime: tokio panics where that happens in asynchronous code, and
        // the app may be dropped in some.
        self.runtime = None;
        if let Some(thread) = self.thread.take() {
            self.driver.close(thread.thread());
            // It only fails if the thread panicked, which has been printed.
            let _ = thread.join();
        }
    }
}

fn listen(port: u16, runtime: &Runtime) -> Result<(TcpListener, SocketAddr), RestError> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let wrap = |source| RestError::Listen { address, source };
    let listener = std::net::TcpListener::bind(address).map_err(wrap)?;
    listener.set_nonblocking(true).map_err(wrap)?;
    let address = listener.local_addr().map_err(wrap)?;
    let _inside = runtime.enter();
    Ok((TcpListener::from_std(listener).map_err(wrap)?, address))
}

fn spawn_driver(
    driver: Arc<RuntimeDriver>,
    runtime: Arc<Runtime>,
    game: Arc<GameHandle>,
) -> Result<JoinHandle<()>, RestError> {
    let run = move || {
        driver.drive_in_background(&runtime);
        runtime.block_on(answer_the_rest(&game));
    };
    let named = std::thread::Builder::new().name("ludus rest".into());
    named.spawn(run).map_err(RestError::Start)
}

/// Lets open requests hear that the game has ended.
async fn answer_the_rest(game: &GameHandle) {
    let all = async {
        while game.has_open() {
            tokio::time::sleep(TICK).await;
        }
        // What was answered is still to be written.
        tokio::time::sleep(TICK).await;
    };
    let _ = tokio::time::timeout(CLOSING_TIME, all).await;
}

async fn accept(listener: TcpListener, game: Arc<GameHandle>) {
    let mut connections = Connections::default();
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                while !connections.make_room() {
                    tokio::time::sleep(TICK).await;
                }
                let game = Arc::clone(&game);
                connections.spawn(|connection| serve(stream, game, connection));
            }
            // Such as too many open files: others may close theirs.
            Err(_) => tokio::time::sleep(TICK).await,
        }
    }
}

async fn serve(stream: TcpStream, game: Arc<GameHandle>, connection: Arc<Connection>) {
    let _ = stream.set_nodelay(true);
    let service = service_fn(|request| answer(&game, &connection, request));
    let stream = WatchedStream::new(stream, Arc::clone(&connection));
    // hyper's own limit for headers would also end connections that rest between two requests.
    let mut http = http1::Builder::new();
    http.header_read_timeout(None);
    let mut served = pin!(http.serve_connection(stream, service));
    let mut overdue = pin!(connection.overdue());
    // An error is that of a connection that broke: there is no client left to answer.
    poll_fn(|context| match served.as_mut().poll(context) {
        Poll::Ready(_) => Poll::Ready(()),
        Poll::Pending => overdue.as_mut().poll(context),
    })
    .await;
}
