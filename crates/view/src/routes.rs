//! Requests to answers.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use axum::{
    Router,
    body::Body,
    extract::{Path, RawQuery, Request, State},
    http::{HeaderValue, StatusCode, header},
    middleware::{Next, from_fn_with_state},
    response::Response,
    routing::get,
};

use crate::{
    Answers, Picture, Refusal, Token, encode,
    guard::{bears, is_loopback, security_headers},
    page,
    pictures::encoded,
    selection::{Query, number_in_path},
};

/// What all requests share.
pub(crate) struct Shared {
    pub answers: Box<dyn Answers>,
    pub token: Token,
}

type Served = State<Arc<Shared>>;
type Reply = Result<(&'static str, Vec<u8>), Refusal>;

const BINARY: &str = "application/octet-stream";
const JSON: &str = "application/json";

/// All routes behind the guard.
pub(crate) fn router(shared: Arc<Shared>) -> Router {
    let api = Router::new()
        .route("/take", get(take))
        .route("/strands/{*what}", get(strands))
        .route("/attribute/{*what}", get(attribute))
        .route("/project/{*what}", get(project))
        .route("/strand/{*what}", get(strand))
        .route("/image/{view}/{frame}", get(image))
        .route("/mask/{view}/{frame}", get(mask))
        .route("/orientation/{view}/{frame}", get(orientation))
        .route("/mesh/head", get(head))
        .route("/mesh/hull/{frame}", get(hull))
        .route("/lines/{frame}", get(lines))
        .route("/arrows/{frame}", get(arrows));
    Router::new()
        .route("/", get(async || file(page::index())))
        .route("/app.js", get(async || file(page::script())))
        .route("/app.css", get(async || file(page::style())))
        .route("/favicon.ico", get(async || answer(StatusCode::NO_CONTENT, "image/x-icon", Vec::new())))
        .nest("/api", api)
        .fallback(async || told(StatusCode::NOT_FOUND, "there is no such address", "docs/view.md has the protocol"))
        .method_not_allowed_fallback(async || {
            told(StatusCode::METHOD_NOT_ALLOWED, "the viewer only reads", "ask with GET")
        })
        .layer(from_fn_with_state(shared.clone(), guarded))
        .with_state(shared)
}

/// Lets through what comes from this machine and carries the token; adds the headers of every answer.
async fn guarded(State(shared): Served, request: Request, next: Next) -> Response {
    let mut response = match refused(&shared.token, &request) {
        Some(response) => response,
        None => next.run(request).await,
    };
    response.headers_mut().extend(security_headers().map(|(name, value)| (Some(name), value)));
    response
}

fn refused(token: &Token, request: &Request) -> Option<Response> {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    if !host.is_some_and(is_loopback) {
        let fact = "the host of the request is not this machine";
        return Some(told(StatusCode::FORBIDDEN, fact, "open the address that `strandflow view` printed"));
    }
    // The page itself holds no data, and is loaded again without the token that it took out of its address.
    let page = ["/", "/app.js", "/app.css", "/favicon.ico"].contains(&request.uri().path());
    let hint = "open the address that `strandflow view` printed, whole";
    (!page && !bears(request.headers(), token))
        .then(|| told(StatusCode::UNAUTHORIZED, "the token is missing or another one", hint))
}

fn answer(status: StatusCode, kind: &'static str, bytes: impl Into<Body>) -> Response {
    let mut response = Response::new(bytes.into());
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}

fn file(file: page::File) -> Response {
    answer(StatusCode::OK, file.kind, file.bytes)
}

fn told(status: StatusCode, error: &str, hint: &str) -> Response {
    answer(status, JSON, serde_json::json!({ "error": error, "hint": hint }).to_string())
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

/// Runs what may read and compute on a thread of its own, so that other requests go on.
async fn work(shared: Arc<Shared>, job: impl FnOnce(&dyn Answers) -> Reply + Send + 'static) -> Response {
    let asked = Asked::default();
    let gone = asked.0.clone();
    let begin = move || if gone.load(Ordering::Relaxed) { Err(nobody_waits()) } else { job(&*shared.answers) };
    match tokio::task::spawn_blocking(begin).await {
        Ok(Ok((kind, bytes))) => answer(StatusCode::OK, kind, bytes),
        Ok(Err(refusal)) => {
            let status = StatusCode::from_u16(refusal.status()).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
            told(status, &refusal.error, &refusal.hint)
        }
        Err(_) => {
            let hint = "the terminal of `strandflow view` says more; please report it";
            told(StatusCode::INTERNAL_SERVER_ERROR, "the program failed on this request", hint)
        }
    }
}

fn json(value: &impl serde::Serialize) -> Reply {
    let bytes = serde_json::to_vec(value);
    let bytes = bytes.map_err(|error| Refusal::broken(format!("JSON: {error}"), "please report it"))?;
    Ok((JSON, bytes))
}

/// A query without any values.
fn nothing(query: Option<&str>) -> Result<(), Refusal> {
    Query::new(query).finish()
}

async fn take(State(shared): Served, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        nothing(query.as_deref())?;
        json(&answers.take()?)
    })
    .await
}

async fn strands(State(shared): Served, Path(what): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let [set, frame] = parts(&what)?;
        let mut query = Query::new(query.as_deref());
        let (selection, bits) = (query.selection()?, query.number("bits", 16..=32)?);
        query.finish()?;
        let found = answers.strands(set, number_in_path("frame", frame)?, &selection)?;
        match bits {
            None | Some(32) => Ok((BINARY, encode::positions(found.points, &found.values))),
            Some(16) => Ok((BINARY, encode::positions_16(found.points, &found.values))),
            Some(bits) => Err(Refusal::bad(format!("`bits={bits}` in the query"), "give 16 or 32")),
        }
    })
    .await
}

async fn attribute(State(shared): Served, Path(what): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let [set, name, frame] = parts(&what)?;
        let mut query = Query::new(query.as_deref());
        let selection = query.selection()?;
        query.finish()?;
        let found = answers.attribute(set, name, number_in_path("frame", frame)?, &selection)?;
        Ok((BINARY, encode::values(found.points, 1, &found.values)))
    })
    .await
}

async fn project(State(shared): Served, Path(what): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let [set, view, frame] = parts(&what)?;
        let mut query = Query::new(query.as_deref());
        let selection = query.selection()?;
        query.finish()?;
        let found = answers.project(set, view, number_in_path("frame", frame)?, &selection)?;
        Ok((BINARY, encode::values(found.points, 2, found.values.as_flattened())))
    })
    .await
}

async fn strand(State(shared): Served, Path(what): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let [set, index] = parts(&what)?;
        nothing(query.as_deref())?;
        json(&answers.strand(set, number_in_path("strand", index)?)?)
    })
    .await
}

async fn image(
    State(shared): Served,
    Path((view, frame)): Path<(String, String)>,
    RawQuery(query): RawQuery,
) -> Response {
    work(shared, move |answers| {
        let mut query = Query::new(query.as_deref());
        let width = query.number("width", 16..=65_535)?;
        query.finish()?;
        encoded(&answers.image(&view, number_in_path("frame", &frame)?)?, width)
    })
    .await
}

/// A picture over a view's footage.
async fn layer(
    shared: Served,
    Path((view, frame)): Path<(String, String)>,
    RawQuery(query): RawQuery,
    of: fn(&dyn Answers, &str, usize) -> Result<Picture, Refusal>,
) -> Response {
    work(shared.0, move |answers| {
        nothing(query.as_deref())?;
        encoded(&of(answers, &view, number_in_path("frame", &frame)?)?, None)
    })
    .await
}

async fn mask(shared: Served, path: Path<(String, String)>, query: RawQuery) -> Response {
    layer(shared, path, query, |answers, view, frame| answers.mask(view, frame)).await
}

async fn orientation(shared: Served, path: Path<(String, String)>, query: RawQuery) -> Response {
    layer(shared, path, query, |answers, view, frame| answers.orientation(view, frame)).await
}

async fn head(State(shared): Served, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        nothing(query.as_deref())?;
        Ok((BINARY, encode::mesh(&answers.head()?)))
    })
    .await
}

async fn hull(State(shared): Served, Path(frame): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        nothing(query.as_deref())?;
        Ok((BINARY, encode::mesh(&answers.hull(number_in_path("frame", &frame)?)?)))
    })
    .await
}

/// The last segments of a path; the first of them may hold slashes, as names of sets do.
fn parts<const N: usize>(path: &str) -> Result<[&str; N], Refusal> {
    let mut found: Vec<&str> = path.rsplitn(N, '/').collect();
    found.reverse();
    found.try_into().map_err(|_| Refusal::bad(format!("`{path}` lacks a part"), "docs/view.md has the protocol"))
}

/// The `most` of a query.
fn most(query: Option<&str>) -> Result<Option<usize>, Refusal> {
    let mut query = Query::new(query);
    let most = query.number("most", 1..=usize::MAX / 4)?;
    query.finish().map(|()| most)
}

async fn lines(State(shared): Served, Path(frame): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let most = most(query.as_deref())?;
        Ok((BINARY, encode::rows(&answers.lines(number_in_path("frame", &frame)?, most)?)))
    })
    .await
}

async fn arrows(State(shared): Served, Path(frame): Path<String>, RawQuery(query): RawQuery) -> Response {
    work(shared, move |answers| {
        let most = most(query.as_deref())?;
        Ok((BINARY, encode::rows(&answers.arrows(number_in_path("frame", &frame)?, most)?)))
    })
    .await
}
