//! A server on the loopback that runs until it is stopped.

use std::{
    io,
    net::{Ipv4Addr, SocketAddr, TcpListener},
    time::Duration,
};

use tokio::sync::watch;

use crate::{Answers, Desk, Token, desk_routes, routes};

/// Time that requests in work get at the end.
const LAST_WORK: Duration = Duration::from_secs(2);

/// A bound server; nothing is answered before [`Server::run`].
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    token: Token,
    stop: watch::Sender<bool>,
}

/// Stops a server from anywhere.
#[derive(Clone)]
pub struct Stop(watch::Sender<bool>);

impl Stop {
    /// Ends [`Server::run`], now or as soon as it begins.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl Server {
    /// Binds a port of 127.0.0.1; 0 is any free one. No other address is ever bound.
    ///
    /// # Errors
    /// The port is in use or may not be bound.
    pub fn bind(port: u16, token: Token) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address, token, stop: watch::Sender::new(false) })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// The address of the page, with the token.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token)
    }

    /// What stops it.
    pub fn stopper(&self) -> Stop {
        Stop(self.stop.clone())
    }

    /// Answers the page of `strandflow view` until it is stopped. At most `threads` requests are worked on at once; others
    /// wait.
    ///
    /// # Errors
    /// The system gives no threads or sockets.
    pub fn run(self, answers: Box<dyn Answers>, threads: usize) -> io::Result<()> {
        let router = routes::router(answers, self.token.clone());
        self.serve(router, threads)
    }

    /// The same for the page of `strandflow annotate`.
    ///
    /// # Errors
    /// As [`Server::run`].
    pub fn run_desk(self, desk: Box<dyn Desk>, threads: usize) -> io::Result<()> {
        let router = desk_routes::router(desk, self.token.clone());
        self.serve(router, threads)
    }

    fn serve(self, router: axum::Router, threads: usize) -> io::Result<()> {
        // One thread moves bytes; what reads and computes has its own.
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(threads.max(1))
            .build()?;
        let mut stopped = self.stop.subscribe();
        let ended = runtime.block_on(async move {
            let listener = tokio::net::TcpListener::from_std(self.listener)?;
            let mut serving = tokio::spawn(async move { axum::serve(listener, router).await });
            tokio::select! {
                ended = &mut serving => ended.unwrap_or_else(|error| Err(io::Error::other(error.to_string()))),
                _ = stopped.wait_for(|stop| *stop) => {
                    serving.abort();
                    Ok(())
                }
            }
        });
        runtime.shutdown_timeout(LAST_WORK);
        ended
    }
}
