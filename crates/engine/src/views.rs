//! Which views take part in the reconstruction, and which are held out to judge it by.

use std::sync::Arc;

use strandflow_core::{ImageSource, RgbImage, Rig, SourceError};

use crate::{EngineError, Manifest, manifest::MANIFEST};

/// The views of a take by their part. A view that is held out gets masks and orientation maps, and is looked at by no
/// stage that makes hulls, poses, scalp, lines or strands; so its images can tell how good the strands are.
#[derive(Clone, Debug)]
pub struct Views {
    taking_part: Vec<usize>,
    held_out: Vec<usize>,
    rig: Rig,
}

/// Fewest views that must take part: below, nothing has a place in space.
const FEWEST: usize = 2;

impl Views {
    /// Sorts the views of a rig by what the manifest says.
    ///
    /// # Errors
    /// `Input` where a name is no view's or fewer than two views would be left.
    pub fn of(manifest: &Manifest, rig: &Rig) -> Result<Self, EngineError> {
        let wrong = |fact: String, hint: &str| Err(EngineError::input(format!("{MANIFEST}, held_out"), fact, hint));
        if let Some(name) = manifest.held_out.iter().find(|name| rig.view_named(name).is_none()) {
            return wrong(format!("there is no view `{name}`"), "write the name of a view as [[views]] has it");
        }
        let held = |view: &usize| manifest.held_out.contains(&rig.cameras[*view].name);
        let (held_out, taking_part): (Vec<usize>, Vec<usize>) = (0..rig.view_count()).partition(held);
        if taking_part.len() < FEWEST {
            let fact = format!("{} views would take part, at least {FEWEST} are needed", taking_part.len());
            return wrong(fact, "hold fewer views out");
        }
        let cameras = taking_part.iter().map(|&view| rig.cameras[view].clone()).collect();
        Ok(Self { taking_part, held_out, rig: Rig { cameras } })
    }

    /// Indices of the views that take part, rising.
    pub fn taking_part(&self) -> &[usize] {
        &self.taking_part
    }

    /// Indices of the views that are held out, rising.
    pub fn held_out(&self) -> &[usize] {
        &self.held_out
    }

    /// The cameras that take part, in the order of [`Views::taking_part`].
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The images of the views that take part.
    pub fn images<'a>(&'a self, all: &'a dyn ImageSource) -> impl ImageSource + 'a {
        Images { views: &self.taking_part, all }
    }
}

struct Images<'a> {
    views: &'a [usize],
    all: &'a dyn ImageSource,
}

impl ImageSource for Images<'_> {
    fn image(&self, view: usize, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        // A view past the last is told by the source itself.
        self.all.image(self.views.get(view).copied().unwrap_or(usize::MAX), frame)
    }
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Camera, Distortion, RigidTransform};

    use super::*;

    fn rig() -> Rig {
        let camera = |name: &str| Camera {
            name: name.into(),
            width: 4,
            height: 4,
            focal: [4.0; 2],
            principal: [2.0; 2],
            distortion: Distortion::None,
            camera_from_world: RigidTransform::IDENTITY,
        };
        Rig { cameras: ["a", "b", "c"].map(camera).into() }
    }

    fn manifest(held_out: &str) -> Manifest {
        let text = format!(
            "fps = 100.0\ngravity = [0, 0, -9810]\nheld_out = {held_out}\nviews = []\n[calibration]\nfile = \"c.json\"\n"
        );
        Manifest::parse(&text, "test").unwrap()
    }

    #[test]
    fn a_view_held_out_leaves_the_others_in_order() {
        let views = Views::of(&manifest("[\"b\"]"), &rig()).unwrap();
        assert_eq!((views.taking_part(), views.held_out()), ([0, 2].as_slice(), [1].as_slice()));
        assert_eq!(views.rig().view_named("c"), Some(1));
    }

    #[test]
    fn a_name_of_no_view_and_too_few_views_are_told() {
        let said = |held_out: &str| Views::of(&manifest(held_out), &rig()).unwrap_err().to_string();
        assert!(said("[\"d\"]").contains("`d`"));
        assert!(said("[\"a\", \"b\"]").contains("1 views"));
    }
}
