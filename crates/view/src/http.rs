//! What the servers of both pages share: the guard before every request, and the form of answers.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use axum::{
    body::Body,
    extract::{Request, State},
    http::{HeaderValue, StatusCode, header},
    middleware::Next,
    response::Response,
};

use crate::{
    Refusal, Token,
    guard::{bears, is_loopback, is_own_origin, security_headers},
    page::File,
};

pub(crate) const BINARY: &str = "application/octet-stream";
pub(crate) const JSON: &str = "application/json";

/// Told of every refusal: the request, the status, and why.
pub(crate) type OnRefusal = Arc<dyn Fn(&str, u16, &str) + Send + Sync>;

/// Who may come in.
pub(crate) struct Gate {
    pub token: Token,
    /// The command that printed the address, for hints.
    pub command: &'static str,
    pub refused: Option<OnRefusal>,
}

/// Lets through what comes from this machine and carries the token; adds the headers of every answer.
pub(crate) async fn guarded(State(gate): State<Arc<Gate>>, request: Request, next: Next) -> Response {
    let asked = gate.refused.is_some().then(|| format!("{} {}", request.method(), request.uri().path()));
    let mut response = match refused(&gate, &request) {
        Some(refusal) => told_refusal(&refusal),
        None => next.run(request).await,
    };
    let why = response.extensions_mut().remove::<Why>();
    let status = response.status();
    if let (Some(told), Some(asked), true) = (&gate.refused, asked, status.as_u16() >= 400) {
        // What is refused before any of our functions is asked says nothing of itself.
        told(&asked, status.as_u16(), why.as_ref().map_or("the address makes no sense", |Why(why)| why));
    }
    response.headers_mut().extend(security_headers().map(|(name, value)| (Some(name), value)));
    response
}

fn refused(gate: &Gate, request: &Request) -> Option<(StatusCode, &'static str, String)> {
    let text = |name| request.headers().get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let hint = || format!("open the address that `{}` printed, whole", gate.command);
    let host = text(header::HOST).filter(|host| is_loopback(host));
    let Some(host) = host else {
        return Some((StatusCode::FORBIDDEN, "the host of the request is not this machine", hint()));
    };
    // A page of another origin that learnt the token still cannot write.
    if request.headers().contains_key(header::ORIGIN) && !text(header::ORIGIN).is_some_and(|o| is_own_origin(o, host)) {
        return Some((StatusCode::FORBIDDEN, "the request comes from another page", hint()));
    }
    // The page itself holds no data, and is loaded again without the token that it took out of its address.
    let page = ["/", "/app.js", "/app.css", "/favicon.ico"].contains(&request.uri().path());
    (!page && !bears(request.headers(), &gate.token))
        .then(|| (StatusCode::UNAUTHORIZED, "the token is missing or another one", hint()))
}

pub(crate) fn answer(status: StatusCode, kind: &'static str, bytes: impl Into<Body>) -> Response {
    let mut response = Response::new(bytes.into());
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}

pub(crate) fn file(file: File) -> Response {
    answer(StatusCode::OK, file.kind, file.bytes)
}

/// Why a request was refused, on its way to the log.
#[derive(Clone)]
struct Why(String);

pub(crate) fn told(status: StatusCode, error: &str, hint: &str) -> Response {
    let mut response = answer(status, JSON, serde_json::json!({ "error": error, "hint": hint }).to_string());
    response.extensions_mut().insert(Why(error.to_owned()));
    response
}

fn told_refusal((status, error, hint): &(StatusCode, &'static str, String)) -> Response {
    told(*status, error, hint)
}

/// A refusal as an answer.
pub(crate) fn refusal(refusal: &Refusal) -> Response {
    let status = StatusCode::from_u16(refusal.status()).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    told(status, &refusal.error, &refusal.hint)
}

/// A value as JSON.
pub(crate) fn to_json(value: &impl serde::Serialize) -> Result<Vec<u8>, Refusal> {
    serde_json::to_vec(value).map_err(|error| Refusal::broken(format!("JSON: {error}"), "please report it"))
}

/// Notes when nobody waits for an answer any more: a browser that scrubs gives requests up, and those that did not begin must
/// not be in the way of the ones it wants.
#[derive(Default)]
struct Asked(Arc<AtomicBool>);

impl Drop for Asked {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn nobody_waits() -> Refusal {
    Refusal::bad("the request was given up", "ask again")
}

/// Runs what may read and compute on a thread of its own, so that other requests go on. What nobody waits for any more does
/// not begin.
///
/// # Errors
/// The answer that says why there is none.
pub(crate) async fn in_background<T: Send + 'static>(
    command: &str,
    job: impl FnOnce() -> Result<T, Refusal> + Send + 'static,
) -> Result<T, Response> {
    let asked = Asked::default();
    let gone = asked.0.clone();
    let begin = move || if gone.load(Ordering::Relaxed) { Err(nobody_waits()) } else { job() };
    match tokio::task::spawn_blocking(begin).await {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(error)) => Err(refusal(&error)),
        Err(_) => {
            let hint = format!("the terminal of `{command}` says more; please report it");
            Err(told(StatusCode::INTERNAL_SERVER_ERROR, "the program failed on this request", &hint))
        }
    }
}
