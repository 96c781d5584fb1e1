//! A running `strandflow view` or `strandflow annotate`, and an HTTP client of a few lines.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use super::text;

/// The folder of the pages, where all is there that drives them; else says what is lacking and that the test is skipped.
pub fn pages() -> Option<PathBuf> {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../web");
    let chromium = std::env::var("CHROMIUM").unwrap_or("/usr/bin/chromium".into());
    let node = Command::new("node").arg("--version").output().is_ok_and(|out| out.status.success());
    let lacking = match () {
        () if !node => "Node",
        () if !Path::new(&chromium).is_file() => "Chromium",
        () if !web.join("node_modules/playwright-core").is_dir() => "web/node_modules (`cargo xtask web`)",
        () if !strandflow_view::page::IS_BUILT => "the built page (`cargo xtask web`)",
        () => return Some(web),
    };
    let must = ["CI", "STRANDFLOW_REQUIRE"].iter().any(|name| std::env::var_os(name).is_some());
    assert!(!must, "the page cannot be tested without {lacking}");
    eprintln!("skipped: no {lacking}");
    None
}

/// The command, serving a take on a free port; ended when it is dropped.
pub struct Viewer {
    child: Child,
    pub port: u16,
    pub token: String,
}

/// An answer: status, headers in lower case, body.
pub struct Answer {
    pub status: u16,
    pub headers: BTreeMap<String, String>,
    pub body: Vec<u8>,
}

impl Viewer {
    /// Serves a take for looking.
    pub fn of(take: &Path, more: &[&str]) -> Self {
        Self::by("view", take, more)
    }

    /// Serves a take by a command.
    pub fn by(command_name: &str, take: &Path, more: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_strandflow"));
        command
            .args([command_name, text(take), "--port", "0"])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut url = String::new();
        BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut url).unwrap();
        let (host, token) = url.trim().strip_prefix("http://127.0.0.1:").unwrap().split_once("/?token=").unwrap();
        Self { port: host.parse().unwrap(), token: token.to_owned(), child }
    }

    /// The address that it printed.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.port, self.token)
    }

    /// Asks with the token.
    pub fn get(&self, path: &str) -> Answer {
        let token = format!("Authorization: Bearer {}", self.token);
        self.ask("GET", path, &["Host: localhost", &token])
    }

    /// The body of an answer that must be there.
    pub fn body(&self, path: &str) -> Vec<u8> {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        answer.body
    }

    /// Asks with these headers alone.
    pub fn ask(&self, method: &str, path: &str, headers: &[&str]) -> Answer {
        self.send(method, path, headers, &[])
    }

    /// Sends a body with these headers alone; its length is not among them.
    pub fn send(&self, method: &str, path: &str, headers: &[&str], body: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let lines: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
        write!(stream, "{method} {path} HTTP/1.1\r\n{lines}Connection: close\r\n\r\n").unwrap();
        stream.write_all(body).unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let mut lines = head.lines();
        let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
        let pair =
            |line: &str| line.split_once(": ").map(|(name, value)| (name.to_lowercase(), value.to_owned())).unwrap();
        Answer { status, headers: lines.map(pair).collect(), body: bytes[end + 4..].to_vec() }
    }

    /// Ends it as Ctrl-C does; what it said, and whether it ended well.
    #[cfg(unix)]
    pub fn interrupt(mut self) -> (String, bool) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
        let well = self.child.wait().unwrap().success();
        let mut said = String::new();
        self.child.stderr.as_mut().unwrap().read_to_string(&mut said).unwrap();
        (said, well)
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        // It may have ended already; both calls fail then, which is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
