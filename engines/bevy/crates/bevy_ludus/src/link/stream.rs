//! TCP and Unix stream sockets as one.

use super::Address;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
#[cfg(unix)]
use std::os::unix::net::{UnixListener, UnixStream};
#[cfg(unix)]
use std::path::PathBuf;
use std::time::Duration;

#[derive(Debug)]
enum Socket {
    Tcp(TcpStream),
    #[cfg(unix)]
    Unix(UnixStream),
}

/// A connected socket.
#[derive(Debug)]
pub(super) struct Stream {
    socket: Socket,
    /// Deadlines that are set, to spare the calls that would set them again.
    read_timeout: Option<Duration>,
    write_timeout: Option<Duration>,
}

/// Calls a method of whichever socket there is.
macro_rules! on_socket {
    ($stream:expr, $socket:ident => $call:expr) => {
        match &$stream.socket {
            Socket::Tcp($socket) => $call,
            #[cfg(unix)]
            Socket::Unix($socket) => $call,
        }
    };
}

impl Stream {
    fn new(socket: Socket) -> Self {
        Self {
            socket,
            read_timeout: None,
            write_timeout: None,
        }
    }

    fn tcp(socket: TcpStream) -> io::Result<Self> {
        socket.set_nonblocking(false)?;
        socket.set_nodelay(true)?;
        Ok(Self::new(Socket::Tcp(socket)))
    }

    pub fn connect(address: &Address, timeout: Duration) -> io::Result<Self> {
        match address {
            Address::Tcp { host, port } => {
                let mut last = ErrorKind::NotFound.into();
                for number in (host.as_str(), *port).to_socket_addrs()? {
                    match TcpStream::connect_timeout(&number, timeout) {
                        Ok(socket) => return Self::tcp(socket),
                        Err(error) => last = error,
                    }
                }
                Err(last)
            }
            #[cfg(unix)]
            Address::Unix(path) => Ok(Self::new(Socket::Unix(UnixStream::connect(path)?))),
            #[cfg(not(unix))]
            Address::Unix(_) => Err(ErrorKind::Unsupported.into()),
        }
    }

    pub fn try_clone(&self) -> io::Result<Self> {
        Ok(Self::new(match &self.socket {
            Socket::Tcp(socket) => Socket::Tcp(socket.try_clone()?),
            #[cfg(unix)]
            Socket::Unix(socket) => Socket::Unix(socket.try_clone()?),
        }))
    }

    pub fn set_nonblocking(&self, is_nonblocking: bool) -> io::Result<()> {
        on_socket!(self, socket => socket.set_nonblocking(is_nonblocking))
    }

    pub fn set_read_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        // Setting it again for a few milliseconds would cost more than it is worth.
        let is_close = |set: Duration| set.abs_diff(timeout) < Duration::from_millis(10);
        if !self.read_timeout.is_some_and(is_close) {
            on_socket!(self, socket => socket.set_read_timeout(Some(timeout)))?;
            self.read_timeout = Some(timeout);
        }
        Ok(())
    }

    pub fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        on_socket!(self, socket => { let mut socket = socket; socket.read(bytes) })
    }

    pub fn write_all(&mut self, bytes: &[u8], timeout: Duration) -> io::Result<()> {
        if self.write_timeout != Some(timeout) {
            on_socket!(self, socket => socket.set_write_timeout(Some(timeout)))?;
            self.write_timeout = Some(timeout);
        }
        on_socket!(self, socket => { let mut socket = socket; socket.write_all(bytes) })
    }
}

/// A socket that listens.
pub(super) enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(UnixListener, PathBuf),
}

impl Listener {
    pub fn bind(address: &Address) -> io::Result<Self> {
        match address {
            Address::Tcp { host, port } => {
                let listener = TcpListener::bind((host.as_str(), *port))?;
                listener.set_nonblocking(true)?;
                Ok(Self::Tcp(listener))
            }
            #[cfg(unix)]
            Address::Unix(path) => {
                let listener = UnixListener::bind(path)?;
                listener.set_nonblocking(true)?;
                Ok(Self::Unix(listener, path.clone()))
            }
            #[cfg(not(unix))]
            Address::Unix(_) => Err(ErrorKind::Unsupported.into()),
        }
    }

    /// Returns who has connected next, if anybody has.
    pub fn accept(&self) -> io::Result<Option<Stream>> {
        let accepted = match self {
            Self::Tcp(listener) => listener.accept().and_then(|(it, _)| Stream::tcp(it)),
            #[cfg(unix)]
            Self::Unix(listener, _) => listener.accept().and_then(|(socket, _)| {
                socket.set_nonblocking(false)?;
                Ok(Stream::new(Socket::Unix(socket)))
            }),
        };
        match accepted {
            Ok(stream) => Ok(Some(stream)),
            // The second one: the client has gone already.
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::ConnectionAborted => Ok(None),
                _ => Err(error),
            },
        }
    }
}

#[cfg(unix)]
impl Drop for Listener {
    fn drop(&mut self) {
        if let Self::Unix(_, path) = self {
            // The name has served; a second game could not listen there.
            let _ = std::fs::remove_file(path);
        }
    }
}
