//! The server over a real socket, with answers made up.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    io::{Read, Write},
    net::TcpStream,
    thread::{self, JoinHandle},
    time::Duration,
};

use glam::Vec3;
use strandflow_core::{Plane, RgbImage, TriMesh};
use strandflow_view::{
    Answers, PerStrand, Picture, Refusal, Selection, Server, Stop, Token,
    describe::{StrandHistory, Take},
};

/// Says what it was asked.
struct Echo;

impl Answers for Echo {
    fn take(&self) -> Result<Take, Refusal> {
        Ok(Take { name: "echo".into(), fps: f64::NAN, ..Take::default() })
    }

    fn strands(&self, set: &str, frame: usize, selection: &Selection) -> Result<PerStrand<Vec3>, Refusal> {
        let numbers = selection.numbers(10)?;
        let point = |n: usize| Vec3::new(n as f32, frame as f32, set.len() as f32);
        Ok(PerStrand { points: 1, values: numbers.into_iter().map(point).collect() })
    }

    fn attribute(&self, set: &str, name: &str, frame: usize, _: &Selection) -> Result<PerStrand<f32>, Refusal> {
        Err(Refusal::missing(format!("{set} {name} {frame}"), "ask for another"))
    }

    fn project(&self, _: &str, _: &str, _: usize, _: &Selection) -> Result<PerStrand<[f32; 2]>, Refusal> {
        Ok(PerStrand { points: 2, values: vec![[1.0, 2.0]; 4] })
    }

    fn strand(&self, _: &str, index: usize) -> Result<StrandHistory, Refusal> {
        Ok(StrandHistory { frames: vec![index], length_mm: vec![None], ..StrandHistory::default() })
    }

    fn image(&self, view: &str, frame: usize) -> Result<Picture, Refusal> {
        // Work that lasts must not keep others waiting.
        thread::sleep(Duration::from_millis(frame as u64));
        Ok(Picture::Photo(RgbImage::filled(view.len(), 2, [1, 2, 3]).into()))
    }

    fn mask(&self, _: &str, _: usize) -> Result<Picture, Refusal> {
        Ok(Picture::Layer(Plane::filled(3, 2, [1, 2, 3, 4])))
    }

    fn orientation(&self, _: &str, _: usize) -> Result<Picture, Refusal> {
        panic!("made up")
    }

    fn head(&self) -> Result<TriMesh, Refusal> {
        Ok(TriMesh::default())
    }

    fn hull(&self, _: usize) -> Result<TriMesh, Refusal> {
        Err(Refusal::broken("the disk is full", "empty it"))
    }

    fn lines(&self, _: usize, most: Option<usize>) -> Result<Vec<[f32; 7]>, Refusal> {
        Ok(vec![[0.5; 7]; most.unwrap_or(1)])
    }

    fn arrows(&self, _: usize, _: Option<usize>) -> Result<Vec<[f32; 6]>, Refusal> {
        Ok(Vec::new())
    }
}

struct Running {
    port: u16,
    token: String,
    stop: Stop,
    ended: Option<JoinHandle<std::io::Result<()>>>,
}

impl Running {
    fn start() -> Self {
        let server = Server::bind(0, Token::random().unwrap()).unwrap();
        let (port, stop) = (server.port(), server.stopper());
        let token = server.url().rsplit_once('=').unwrap().1.to_owned();
        assert_eq!(server.url(), format!("http://127.0.0.1:{port}/?token={token}"));
        Self { port, token, stop, ended: Some(thread::spawn(move || server.run(Box::new(Echo), 2))) }
    }

    /// Status, head and body.
    fn ask(&self, method: &str, path: &str, headers: &str) -> (u16, String, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        write!(stream, "{method} {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n").unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap().to_lowercase();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), head, bytes[end + 4..].to_vec())
    }

    fn get(&self, path: &str) -> (u16, String, Vec<u8>) {
        self.ask("GET", path, &format!("Host: localhost\r\nAuthorization: Bearer {}\r\n", self.token))
    }

    fn text(&self, path: &str) -> (u16, String) {
        let (status, _, body) = self.get(path);
        (status, String::from_utf8(body).unwrap())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.stop();
        let ended = self.ended.take().unwrap().join().unwrap();
        assert!(ended.is_ok() && TcpStream::connect(("127.0.0.1", self.port)).is_err(), "the port is given back");
    }
}

#[test]
fn answers_are_encoded_as_the_protocol_says() {
    let server = Running::start();
    let (status, take) = server.text("/api/take");
    assert!(status == 200 && take.contains("\"name\":\"echo\"") && take.contains("\"fps\":null"), "{take}");
    for path in ["/api/strands/animate/own/7?first=2&count=2", "/api/strands/animate%2Fown/7?first=2&count=2"] {
        let (status, head, body) = server.get(path);
        assert!(status == 200 && head.contains("content-type: application/octet-stream"));
        let floats: Vec<f32> = body[16..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(
            (&body[4..16], floats),
            (&[2, 0, 0, 0, 1, 0, 0, 0, 32, 0, 0, 0][..], vec![2.0, 7.0, 11.0, 3.0, 7.0, 11.0])
        );
    }
    assert_eq!(server.get("/api/strands/s/7?bits=16").2.len(), 16 + 48 + 10 * 6);
    assert_eq!(server.get("/api/project/s/cam/7").2.len(), 16 + 32);
    assert_eq!(server.text("/api/strand/s/4").1.split(",\"speed").next(), Some("{\"frames\":[4],\"length_mm\":[null]"));
    assert_eq!(server.get("/api/lines/1?most=3").2.len(), 16 + 3 * 28);
    assert_eq!((server.get("/api/arrows/1").2.len(), server.get("/api/mesh/head").2.len()), (16, 16));
    let (_, head, body) = server.get("/api/image/cam/0");
    assert!(head.contains("content-type: image/jpeg") && body.starts_with(&[0xff, 0xd8]));
    let (_, head, body) = server.get("/api/mask/cam/0");
    assert!(head.contains("content-type: image/png") && body.starts_with(b"\x89PNG"));
}

#[test]
fn refusals_are_json_with_a_hint() {
    let server = Running::start();
    for (path, status, word) in [
        ("/api/attribute/animate/own/speed/3", 404, "animate/own speed 3"),
        ("/api/mesh/hull/1", 500, "the disk is full"),
        ("/api/orientation/cam/1", 500, "failed on this request"),
        ("/api/strands/s/-1", 400, "`-1`"),
        ("/api/strands/s", 400, "lacks a part"),
        ("/api/strands/s/1?count=11", 400, "strand 10"),
        ("/api/strands/s/1?bits=17", 400, "bits=17"),
        ("/api/take?x=1", 400, "`x`"),
        ("/api", 404, "address"),
        ("/other", 404, "address"),
    ] {
        let (found, text) = server.text(path);
        assert!(found == status && text.contains(word) && text.contains("\"hint\":\""), "{path}: {found} {text}");
    }
    // After a panic it goes on.
    assert_eq!(server.get("/api/take").0, 200);
}

#[test]
fn who_may_not_ask_learns_nothing() {
    let server = Running::start();
    let bearer = format!("Authorization: Bearer {}\r\n", server.token);
    let ask = |path: &str, headers: &str| server.ask("GET", path, headers).0;
    assert_eq!((ask("/api/take", "Host: localhost\r\n"), ask("/nothing", "Host: localhost\r\n")), (401, 401));
    assert_eq!(ask("/api/take", &format!("Host: evil.example\r\n{bearer}")), 403);
    // Without a host there is nothing to check.
    assert!([400, 403].contains(&ask("/api/take", &bearer)));
    assert_eq!(ask("/api/take", &format!("Host: 127.0.0.1:7\r\n{bearer}")), 200);
    assert_eq!(server.ask("DELETE", "/api/take", &format!("Host: localhost\r\n{bearer}")).0, 405);
    for path in ["/", "/app.js", "/api/take", "/favicon.ico"] {
        let (_, head, _) = server.ask("GET", path, "Host: localhost\r\n");
        let wanted = [
            "content-security-policy: default-src 'none'",
            "cache-control: no-store",
            "x-content-type-options: nosniff",
        ];
        wanted.iter().for_each(|header| assert!(head.contains(header), "{path}: {head}"));
        assert!(!head.contains("access-control"));
    }
}

#[test]
fn long_work_keeps_nobody_waiting() {
    let server = Running::start();
    let begun = std::time::Instant::now();
    thread::scope(|scope| {
        scope.spawn(|| server.get("/api/image/cam/3000"));
        thread::sleep(Duration::from_millis(100));
        assert_eq!((server.get("/api/take").0, server.get("/").0), (200, 200));
        assert!(begun.elapsed() < Duration::from_millis(2500), "{:?}", begun.elapsed());
    });
}
