//! Everything beside strands: footage, masks, orientation, head, hull, lines, velocities.

use strandflow_core::{Camera, ImageSource, Plane, SparseVoxels, TriMesh};
use strandflow_engine::{EngineError, Item, store::Store};
use strandflow_eval::statistics::evenly;
use strandflow_geometry::surface_nets::surface;
use strandflow_report::hue::colour_of_angle;
use strandflow_view::{Picture, Refusal};

use super::source::{Source, broken};

/// Colours of masks: hair, and subject without hair. Distinct in lightness too, and half transparent over footage.
const HAIR: [u8; 3] = [255, 140, 40];
const SUBJECT: [u8; 3] = [60, 130, 240];
const MASK_OPACITY: u16 = 130;
/// Samples of the hull's surface are at least so far apart \[mm\]: finer shows the steps of the voxels and takes four times the
/// bytes.
const HULL_MM: f64 = 4.0;

/// The index of a view.
fn index_of(source: &Source, view: &str) -> Result<usize, Refusal> {
    let views = &source.manifest().views;
    views.iter().position(|known| known.name == view).ok_or_else(|| {
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        Refusal::missing(format!("there is no view `{view}`"), format!("views: {}", names.join(", ")))
    })
}

/// A view's index and camera.
///
/// # Errors
/// There is no such view, or no calibration.
pub fn camera<'a>(source: &'a Source, view: &str) -> Result<(usize, &'a Camera), Refusal> {
    let index = index_of(source, view)?;
    // A rig that was read has a camera for every view.
    let camera = source.rig().and_then(|rig| rig.cameras.get(index));
    camera.map(|camera| (index, camera)).ok_or_else(|| {
        let hint = "look at what `strandflow view` said when it began";
        Refusal::missing(format!("view {view} has no camera: the calibration cannot be read"), hint)
    })
}

/// The results, if an item of them is there.
fn with_item(source: &Source, key: &str, what: &str) -> Result<Store, Refusal> {
    let store = source.store()?;
    match store.record(key) {
        Some(_) => Ok(store),
        None => Err(Refusal::missing(format!("there is no {what}: `{key}` is not done"), source.run_hint())),
    }
}

/// The footage.
///
/// # Errors
/// There is none of this view and frame, or it cannot be decoded.
pub fn image(source: &Source, view: &str, frame: usize) -> Result<Picture, Refusal> {
    let index = index_of(source, view)?;
    let Some(footage) = source.footage(index) else {
        let hint = format!("the manifest says it is at {}", source.manifest().views[index].source);
        return Err(Refusal::missing(format!("the footage of view {view} cannot be opened"), hint));
    };
    if frame >= footage.frame_count() {
        let fact = format!("view {view} has no frame {frame}");
        return Err(Refusal::missing(fact, format!("its footage has {} frames", footage.frame_count())));
    }
    let image = footage.image(0, frame).map_err(|error| Refusal::broken(error.to_string(), error.hint))?;
    Ok(Picture::Photo(image))
}

/// Hair and subject.
///
/// # Errors
/// There are no masks of this view and frame.
pub fn mask(source: &Source, view: &str, frame: usize) -> Result<Picture, Refusal> {
    let (view, camera) = camera(source, view)?;
    let store = with_item(source, &Item::ViewFrame(view, frame).key("masks/masks"), "mask of this view and frame")?;
    let masks = store.read_masks(view, frame, (camera.width, camera.height)).map_err(broken)?;
    let pixels = masks.hair.data.iter().zip(&masks.subject.data).map(|(&hair, &subject)| {
        let ([r, g, b], cover) = if hair >= 128 { (HAIR, hair) } else { (SUBJECT, subject) };
        // What is nearly nothing would only grey the picture.
        if cover < 16 { [0; 4] } else { [r, g, b, (u16::from(cover) * MASK_OPACITY / 255) as u8] }
    });
    Ok(Picture::Layer(Plane { width: camera.width, height: camera.height, data: pixels.collect() }))
}

/// Orientation map.
///
/// # Errors
/// There is none of this view and frame.
pub fn orientation(source: &Source, view: &str, frame: usize) -> Result<Picture, Refusal> {
    let (view, camera) = camera(source, view)?;
    let key = Item::ViewFrame(view, frame).key("orient/orient");
    let store = with_item(source, &key, "orientation map of this view and frame")?;
    let map = store.read_orientation(view, frame, (camera.width, camera.height)).map_err(broken)?;
    let pixels = map.angle.data.iter().zip(&map.confidence.data).map(|(angle, confidence)| {
        if *confidence <= 0.0 {
            return [0; 4];
        }
        let [r, g, b] = colour_of_angle(*angle, 1.0);
        [r, g, b, (255.0 * confidence.clamp(0.0, 1.0)).round() as u8]
    });
    Ok(Picture::Layer(Plane { width: camera.width, height: camera.height, data: pixels.collect() }))
}

/// The head.
///
/// # Errors
/// Stage scalp is not done.
pub fn head(source: &Source) -> Result<TriMesh, Refusal> {
    let store = with_item(source, &Item::Take.key("scalp/scalp"), "head")?;
    Ok(store.read_scalp().map_err(broken)?.mesh)
}

/// The hull's surface.
///
/// # Errors
/// There is no hull of the frame.
pub fn hull(source: &Source, frame: usize) -> Result<TriMesh, Refusal> {
    let store = with_item(source, &Item::Frame(frame).key("hull/hull"), "hull of this frame")?;
    let hull = store.read_hull(frame).map_err(broken)?;
    let factor = (HULL_MM / hull.grid.voxel_mm).ceil().clamp(1.0, 8.0) as usize;
    Ok(surface(&hull, factor))
}

/// Lifted lines.
///
/// # Errors
/// There are none of the frame.
pub fn lines(source: &Source, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 7]>, Refusal> {
    let store = with_item(source, &Item::Frame(frame).key("lift/lift"), "lifted line of this frame")?;
    voxels(store.read_lines(frame), most, |[x, y, z], line| {
        let [dx, dy, dz] = line.direction.to_array();
        [x, y, z, dx, dy, dz, line.confidence]
    })
}

/// Velocities.
///
/// # Errors
/// There are none of the frame.
pub fn arrows(source: &Source, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 6]>, Refusal> {
    let store = with_item(source, &Item::Frame(frame).key("flow/flow"), "velocity field of this frame")?;
    voxels(store.read_flow(frame), most, |[x, y, z], velocity| {
        let [dx, dy, dz] = velocity.to_array();
        [x, y, z, dx, dy, dz]
    })
}

/// Rows of some voxels, evenly chosen.
fn voxels<T, const N: usize>(
    read: Result<SparseVoxels<T>, EngineError>,
    most: Option<usize>,
    row: impl Fn([f32; 3], &T) -> [f32; N],
) -> Result<Vec<[f32; N]>, Refusal> {
    let voxels = read.map_err(broken)?;
    let centre = |i: usize| voxels.grid.centre_of_index(voxels.indices[i] as usize).as_vec3().to_array();
    let chosen = evenly(voxels.len(), most.unwrap_or(usize::MAX));
    Ok(chosen.into_iter().map(|i| row(centre(i), &voxels.values[i])).collect())
}
