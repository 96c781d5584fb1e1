//! One running ffmpeg: decoded frames of one video in order, over a pipe.

use std::{
    ffi::OsString,
    io::Read,
    path::Path,
    process::{Child, ChildStdout, Command, Stdio},
    thread::JoinHandle,
};

use strandflow_core::{Plane, RgbImage};

use super::{SourceInfo, probe::program_error};
use crate::{IoError, error::At};

/// A process that decodes a video from some frame on.
pub(super) struct Decoder {
    child: Child,
    pipe: ChildStdout,
    said: Option<JoinHandle<String>>,
    /// The frame that comes next.
    pub next: usize,
}

/// The input of ffmpeg and ffprobe: this file, which is neither an option nor an address, whatever its name; and what it holds may
/// not lead to the network.
pub(super) fn only_this_file(path: &Path) -> [OsString; 4] {
    let mut file = OsString::from("file:");
    file.push(path);
    ["-protocol_whitelist".into(), "file".into(), "-i".into(), file]
}

impl Decoder {
    /// Starts ffmpeg so that `first` comes out first. Frames before it are decoded and dropped there: seeking in a video
    /// with B-frames or an odd start time is off by frames often enough.
    pub fn start(path: &Path, first: usize) -> Result<Self, IoError> {
        let mut command = Command::new("ffmpeg");
        command.args(["-nostdin", "-v", "error", "-threads", "2"]);
        // Left to itself ffmpeg paints over damaged parts of a frame, or drops the frame, and later ones take its number:
        // both would go into the results unseen.
        command.args(["-xerror", "-err_detect", "explode"]).args(only_this_file(path));
        command.args(["-map", "0:v:0", "-an", "-sn", "-vsync", "passthrough"]);
        if first > 0 {
            command.args(["-vf", &format!("select=gte(n\\,{first})")]);
        }
        command.args(["-sws_flags", "bicubic+accurate_rnd+full_chroma_int+bitexact"]);
        command.args(["-pix_fmt", "rgb24", "-f", "rawvideo", "pipe:1"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is for us: in a group of its own the decoder lives until the work in flight is done.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|cause| program_error(path, "ffmpeg", cause))?;
        let pipes = child.stdout.take().zip(child.stderr.take());
        let Some((pipe, errors)) = pipes else {
            return Err(program_error(path, "ffmpeg", std::io::Error::other("no pipe")));
        };
        let said = std::thread::spawn(move || tail_of(errors));
        Ok(Self { child, pipe, said: Some(said), next: first })
    }

    /// The next frame.
    pub fn read(&mut self, path: &Path, view: &str, info: &SourceInfo) -> Result<RgbImage, IoError> {
        let mut data = vec![[0u8; 3]; info.width * info.height];
        if let Err(cause) = self.pipe.read_exact(data.as_flattened_mut()) {
            let said = self.stop();
            let why = said.trim().lines().last().map_or_else(|| cause.to_string(), str::to_owned);
            return Err(IoError::content(
                path,
                At::view_frame(view, self.next),
                format!("the video could not be decoded: {why}"),
                "play it to this frame with ffplay; if it is damaged, copy it again or convert it",
            ));
        }
        self.next += 1;
        Ok(Plane { width: info.width, height: info.height, data })
    }

    fn stop(&mut self) -> String {
        // The process may be gone already; both calls fail then, which is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.said.take().and_then(|thread| thread.join().ok()).unwrap_or_default()
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The last 4 KiB of a stream, read to its end so that the writer never blocks.
fn tail_of(mut stream: impl Read) -> String {
    let mut tail = Vec::new();
    let mut chunk = [0u8; 1024];
    while let Ok(count @ 1..) = stream.read(&mut chunk) {
        tail.extend_from_slice(&chunk[..count]);
        let surplus = tail.len().saturating_sub(4096);
        tail.drain(..surplus);
    }
    String::from_utf8_lossy(&tail).into_owned()
}
