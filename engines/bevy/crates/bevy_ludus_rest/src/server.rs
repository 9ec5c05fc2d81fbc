//! The HTTP server.

use super::answer::answer;
use super::error::RestError;
use super::front::Front;
use super::seat::Seat;
use bevy_ecs::resource::Resource;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Handle, Runtime};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// More connections wait until one of these is closed.
const MAX_CONNECTIONS: usize = 64;
/// How long the last answers may take when the app ends.
const FAREWELL: Duration = Duration::from_millis(250);
const TICK: Duration = Duration::from_millis(1);

/// The server that clients of bevy_rl talk to. It ends with the app.
#[derive(Resource)]
pub struct RestServer {
    address: SocketAddr,
    front: Arc<Front>,
    seat: Arc<Seat>,
    /// None while it is dropped.
    runtime: Option<Arc<Runtime>>,
    keeper: Option<JoinHandle<()>>,
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

    pub(super) fn start(port: u16, front: Front) -> Result<Self, RestError> {
        let runtime = Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build();
        let runtime = Arc::new(runtime.map_err(RestError::Start)?);
        let front = Arc::new(front);
        let (listener, address) = listen(port, &runtime)?;
        runtime.spawn(accept(listener, Arc::clone(&front)));
        let seat = Arc::new(Seat::default());
        let keeper = keep(Arc::clone(&seat), Arc::clone(&runtime), Arc::clone(&front))?;
        let (runtime, keeper) = (Some(runtime), Some(keeper));
        Ok(Self {
            address,
            front,
            seat,
            runtime,
            keeper,
        })
    }

    /// Blocks until a request waits for the game, for some time.
    pub(super) fn wait(&self, limit: Duration) {
        match &self.runtime {
            // An app that runs inside a runtime of its own cannot drive another one.
            Some(runtime) if Handle::try_current().is_err() => {
                self.seat
                    .sit_until(runtime, limit, self.front.desk.arrival());
            }
            _ => self.front.desk.wait(limit),
        }
    }
}

impl Drop for RestServer {
    fn drop(&mut self) {
        self.front.desk.close();
        // The keeper drops the runtime: nothing asynchronous may do that, and this might be.
        self.runtime = None;
        if let Some(keeper) = self.keeper.take() {
            self.seat.close(keeper.thread());
            // It only fails if the thread panicked, which has been printed.
            let _ = keeper.join();
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

fn keep(
    seat: Arc<Seat>,
    runtime: Arc<Runtime>,
    front: Arc<Front>,
) -> Result<JoinHandle<()>, RestError> {
    let run = move || {
        seat.keep(&runtime);
        runtime.block_on(say_farewell(&front));
    };
    let named = std::thread::Builder::new().name("ludus rest".into());
    named.spawn(run).map_err(RestError::Start)
}

/// Lets open requests hear that the game has ended.
async fn say_farewell(front: &Front) {
    let all = async {
        while front.has_open() {
            tokio::time::sleep(TICK).await;
        }
        // What was answered is still to be written.
        tokio::time::sleep(TICK).await;
    };
    let _ = tokio::time::timeout(FAREWELL, all).await;
}

async fn accept(listener: TcpListener, front: Arc<Front>) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    while let Ok(place) = Arc::clone(&places).acquire_owned().await {
        match listener.accept().await {
            Ok((stream, _)) => {
                tokio::spawn(serve(stream, Arc::clone(&front), place));
            }
            // Such as too many open files: others may close theirs.
            Err(_) => tokio::time::sleep(TICK).await,
        }
    }
}

async fn serve(stream: TcpStream, front: Arc<Front>, _place: OwnedSemaphorePermit) {
    let _ = stream.set_nodelay(true);
    let service = service_fn(move |request| {
        let front = Arc::clone(&front);
        async move { answer(&front, request).await }
    });
    // A connection that breaks has nobody left to tell.
    let _ = http1::Builder::new()
        .serve_connection(TokioIo::new(stream), service)
        .await;
}
