//! What a video holds, asked of ffprobe: size as shown (rotation applied), frame rate, and packets counted (headers lie).

use std::{path::Path, process::Command};

use serde::Deserialize;

use super::{SourceInfo, decoder::only_this_file};
use crate::{IoError, error::At};

#[derive(Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<Stream>,
}

#[derive(Deserialize)]
struct Stream {
    #[serde(default)]
    width: usize,
    #[serde(default)]
    height: usize,
    #[serde(default)]
    avg_frame_rate: String,
    #[serde(default)]
    nb_read_packets: String,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Deserialize)]
struct SideData {
    #[serde(default)]
    rotation: f64,
}

/// Asks ffprobe for the first video stream's size, frame rate and number of frames. Reads the whole file, decodes nothing.
///
/// # Errors
/// The file is missing, ffprobe is missing, or the file is no video with frames.
pub fn probe_video(path: &Path) -> Result<SourceInfo, IoError> {
    if let Err(cause) = std::fs::metadata(path) {
        return Err(IoError::reading(path)(cause));
    }
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "v:0", "-count_packets", "-of", "json", "-show_entries"])
        .arg("stream=width,height,avg_frame_rate,nb_read_packets:stream_side_data=rotation")
        .args(only_this_file(path))
        .output()
        .map_err(|cause| program_error(path, "ffprobe", cause))?;
    let unreadable = |fact: String| {
        let hint = "play it with ffplay; if it is damaged, copy it again or convert it (`ffmpeg -i IN OUT.mp4`)";
        IoError::content(path, At::FILE, fact, hint)
    };
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(unreadable(format!(
            "is no readable video: {}",
            said.trim().lines().last().unwrap_or("ffprobe failed")
        )));
    }
    info_from_json(&output.stdout).map_err(unreadable)
}

fn info_from_json(json: &[u8]) -> Result<SourceInfo, String> {
    let probed: Probed =
        serde_json::from_slice(json).map_err(|cause| format!("ffprobe's answer is not understood: {cause}"))?;
    let stream = probed.streams.first().ok_or("holds no video stream")?;
    let turned = stream.side_data_list.iter().any(|data| (data.rotation.abs() % 180.0 - 90.0).abs() < 1.0);
    let (width, height) = if turned { (stream.height, stream.width) } else { (stream.width, stream.height) };
    let frame_count = stream.nb_read_packets.parse().unwrap_or(0);
    if width == 0 || height == 0 || frame_count == 0 {
        return Err("holds no frames".into());
    }
    let (numerator, denominator) = stream.avg_frame_rate.split_once('/').unwrap_or((&stream.avg_frame_rate, "1"));
    let fps = numerator.parse::<f64>().ok().zip(denominator.parse::<f64>().ok()).map(|(n, d)| n / d);
    Ok(SourceInfo { width, height, frame_count, fps: fps.filter(|fps| fps.is_finite() && *fps > 0.0) })
}

/// A program that could not be started.
pub(super) fn program_error(path: &Path, program: &'static str, cause: std::io::Error) -> IoError {
    match cause.kind() {
        std::io::ErrorKind::NotFound => IoError::Program { program, file: path.to_owned() },
        _ => IoError::System { file: path.to_owned(), action: "start ffmpeg for", cause },
    }
}

/// Whether ffmpeg and ffprobe can be started.
pub fn ffmpeg_is_installed() -> bool {
    let runs =
        |program: &str| Command::new(program).arg("-version").output().is_ok_and(|output| output.status.success());
    runs("ffmpeg") && runs("ffprobe")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_of_ffprobe() {
        let json =
            br#"{"streams": [{"width": 640, "height": 480, "avg_frame_rate": "60000/1001", "nb_read_packets": "30",
            "side_data_list": [{"rotation": -90}]}]}"#;
        let info = info_from_json(json).unwrap();
        assert_eq!((info.width, info.height, info.frame_count), (480, 640, 30));
        assert!((info.fps.unwrap() - 59.94).abs() < 1e-2);
        assert!(info_from_json(b"{}").is_err() && info_from_json(b"\xff").is_err());
        assert!(info_from_json(br#"{"streams": [{"width": 640, "height": 480}]}"#).is_err());
    }
}
