//! Per-view, per-frame image arrays. Views of different sizes share arrays of the largest; the rest is zero.

use serde_json::json;
use strandflow_core::Plane;

use super::ensure;
use crate::{
    EngineError,
    store::{Element, Writer},
    table::Job,
};

/// The size of a plane that belongs to an image of some size (width, height).
pub(crate) type Scale = fn((usize, usize)) -> (usize, usize);

/// Planes of the images' own size.
pub(crate) const FULL: Scale = |size| size;

/// Makes image arrays for all frames and views.
pub(crate) fn ensure_images(job: &Job, phase: &str, paths: &[&str], scale: Scale) -> Result<(), EngineError> {
    let (width, height) = scale(largest(job));
    let names: Vec<&str> = job.take.rig().cameras.iter().map(|camera| camera.name.as_str()).collect();
    let shape = [job.plan.end, names.len(), height, width];
    for path in paths {
        ensure(job, phase, (path, json!({ "views": names })), &shape, &[1, 1, height, width])?;
    }
    Ok(())
}

/// Writes one image.
pub(crate) fn write_image<T: Element + Default>(
    job: &Job,
    out: &mut Writer,
    (path, scale): (&str, Scale),
    (view, frame): (usize, usize),
    plane: &Plane<T>,
) -> Result<(), EngineError> {
    let (width, height) = scale(largest(job));
    if (plane.width, plane.height) == (width, height) {
        return out.chunk(path, &[frame, view, 0, 0], &plane.data);
    }
    let mut padded = Plane::filled(width, height, T::default());
    for y in 0..plane.height.min(height) {
        let n = plane.width.min(width);
        padded.data[y * width..y * width + n].copy_from_slice(&plane.row(y)[..n]);
    }
    out.chunk(path, &[frame, view, 0, 0], &padded.data)
}

fn largest(job: &Job) -> (usize, usize) {
    let cameras = &job.take.rig().cameras;
    let most = |size: fn(&strandflow_core::Camera) -> usize| cameras.iter().map(size).max().unwrap_or(1);
    (most(|c| c.width), most(|c| c.height))
}
