//! Requests to answers.

use std::sync::Arc;

use axum::{
    Router,
    extract::{Path, RawQuery, State},
    http::StatusCode,
    middleware::from_fn_with_state,
    response::Response,
    routing::get,
};

use crate::{
    Answers, Picture, Refusal, Token, encode,
    http::{BINARY, Gate, JSON, answer, file, guarded, in_background, to_json, told},
    page::VIEW,
    pictures::encoded,
    selection::{Query, number_in_path},
};

/// What all requests share.
pub(crate) struct Shared {
    pub answers: Box<dyn Answers>,
}

type Served = State<Arc<Shared>>;
type Reply = Result<(&'static str, Vec<u8>), Refusal>;

/// All routes behind the guard.
pub(crate) fn router(answers: Box<dyn Answers>, token: Token) -> Router {
    let shared = Arc::new(Shared { answers });
    let gate = Arc::new(Gate { token, command: "strandflow view", refused: None });
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
        .route("/", get(async || file(VIEW.index)))
        .route("/app.js", get(async || file(VIEW.script)))
        .route("/app.css", get(async || file(VIEW.style)))
        .route("/favicon.ico", get(async || answer(StatusCode::NO_CONTENT, "image/x-icon", Vec::new())))
        .nest("/api", api)
        .fallback(async || told(StatusCode::NOT_FOUND, "there is no such address", "docs/view.md has the protocol"))
        .method_not_allowed_fallback(async || {
            told(StatusCode::METHOD_NOT_ALLOWED, "the viewer only reads", "ask with GET")
        })
        .layer(from_fn_with_state(gate, guarded))
        .with_state(shared)
}

/// Answers on a thread of its own.
async fn work(shared: Arc<Shared>, job: impl FnOnce(&dyn Answers) -> Reply + Send + 'static) -> Response {
    match in_background("strandflow view", move || job(&*shared.answers)).await {
        Ok((kind, bytes)) => answer(StatusCode::OK, kind, bytes),
        Err(response) => response,
    }
}

fn json(value: &impl serde::Serialize) -> Reply {
    Ok((JSON, to_json(value)?))
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
