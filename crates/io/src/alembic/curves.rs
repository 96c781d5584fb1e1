//! A curves object of AbcGeom: samples a frame as they arrive, then what stays.

use std::io::Result;

use glam::Vec3;

use super::{
    archive::Object,
    ogawa::Ogawa,
    property::{Body, Pod, Property, Samples, Shape},
};
use crate::{
    guides::Guides,
    scene::{Sample, Scene, extent},
};

/// Curves of a scene that make one object.
pub(super) struct CurveObject {
    name: &'static str,
    /// Which strands of the scene, in its order.
    curves: Vec<usize>,
    /// Where their points lie in a sample.
    ranges: Vec<std::ops::Range<usize>>,
    ids: Vec<i32>,
    is_guide: bool,
    /// The id of each curve's guide.
    closest: Option<Vec<i32>>,
    moving: Moving,
}

struct Moving {
    bounds: Samples,
    points: Samples,
    provenance: Samples,
    confidence: Samples,
}

impl CurveObject {
    /// The strands, and the guides where there are some.
    pub fn of(scene: &Scene, guides: Option<&Guides>) -> Vec<Self> {
        let ranges = scene.curves.ranges();
        let ids: Vec<i32> = scene.curves.strands.iter().map(|&strand| strand as i32).collect();
        let first_guide = ids.last().map_or(0, |last| last + 1);
        let closest = guides.map(|guides| {
            let guide = |&strand: &u32| first_guide + guides.guide_of(strand).unwrap_or(0) as i32;
            scene.curves.strands.iter().map(guide).collect()
        });
        let all = (0..ranges.len()).collect();
        let mut objects = vec![Self::new("strands", all, &ranges, ids, closest)];
        if let Some(guides) = guides {
            // Curves that the scene lacks cannot be guides of its strands.
            let curve = |strand| scene.curves.strands.binary_search(strand).unwrap_or(0);
            let curves: Vec<usize> = guides.strands.iter().map(curve).collect();
            let ids = (first_guide..).take(curves.len()).collect();
            objects.push(Self { is_guide: true, ..Self::new("guides", curves, &ranges, ids, None) });
        }
        objects
    }

    fn new(
        name: &'static str,
        curves: Vec<usize>,
        ranges: &[std::ops::Range<usize>],
        ids: Vec<i32>,
        closest: Option<Vec<i32>>,
    ) -> Self {
        let ranges = curves.iter().map(|&curve| ranges[curve].clone()).collect();
        let moving = Moving {
            bounds: Samples::new(Pod::Float64, 6, Shape::Scalar),
            points: Samples::new(Pod::Float32, 3, Shape::Many),
            provenance: Samples::new(Pod::Int32, 1, Shape::Many),
            confidence: Samples::new(Pod::Float32, 1, Shape::Many),
        };
        Self { name, curves, ranges, ids, is_guide: false, closest, moving }
    }

    /// Writes what this object has of a frame.
    pub fn put_frame(&mut self, file: &mut Ogawa, sample: &Sample, width: f32) -> Result<()> {
        let points: Vec<Vec3> = self.gather(&sample.points);
        let bounds: Vec<u8> = extent(&points, width)
            .into_iter()
            .flat_map(|p| p.as_dvec3().to_array())
            .flat_map(f64::to_le_bytes)
            .collect();
        let (provenance, confidence) = (self.gather(&sample.provenance), self.gather(&sample.confidence));
        self.moving.bounds.push(file, &bounds)?;
        self.moving.points.push(file, &floats(points.into_iter().flat_map(|p| p.to_array())))?;
        self.moving.provenance.push(file, &ints(provenance))?;
        self.moving.confidence.push(file, &floats(confidence))
    }

    fn gather<T: Copy>(&self, all: &[T]) -> Vec<T> {
        self.ranges.iter().flat_map(|range| &all[range.clone()]).copied().collect()
    }

    /// Writes what stays, and the object.
    pub fn finish(self, file: &mut Ogawa, scene: &Scene) -> Result<Object> {
        let width = floats([scene.width()]);
        // Linear, open, no basis.
        let kind = Samples::of(file, (Pod::Uint8, 4, Shape::Scalar), &[1, 0, 0, 0])?;
        let counts = Samples::of(file, INTS, &ints(self.ranges.iter().map(|range| range.len() as i32)))?;
        let own_width = Samples::of(file, FLOAT, &width)?;
        let arbitrary = self.attributes(file, scene, &width)?;
        let Moving { bounds, points, .. } = self.moving;
        let geometry = vec![
            Property { name: ".selfBnds", metadata: "interpretation=box", body: Body::Samples(bounds) },
            Property { name: "P", metadata: "geoScope=vtx;interpretation=point", body: Body::Samples(points) },
            Property { name: "nVertices", metadata: "", body: counts },
            Property { name: "curveBasisAndType", metadata: "", body: kind },
            Property { name: "width", metadata: FLOAT_CONSTANT, body: own_width },
            Property {
                name: ".arbGeomParams",
                metadata: "",
                body: Body::Compound(
                    arbitrary
                        .into_iter()
                        .chain([
                            Property {
                                name: "provenance",
                                metadata: INT_VERTEX,
                                body: Body::Samples(self.moving.provenance),
                            },
                            Property {
                                name: "confidence",
                                metadata: FLOAT_VERTEX,
                                body: Body::Samples(self.moving.confidence),
                            },
                        ])
                        .collect(),
                ),
            },
        ];
        let metadata = "schema=AbcGeom_Curve_v2;schemaBaseType=AbcGeom_GeomBase_v1";
        let geometry = Property { name: ".geom", metadata, body: Body::Compound(geometry) };
        let metadata =
            "schema=AbcGeom_Curve_v2;schemaBaseType=AbcGeom_GeomBase_v1;schemaObjTitle=AbcGeom_Curve_v2:.geom";
        Object::write(file, (self.name, metadata), &[geometry], &[])
    }

    /// The groom's attributes that do not move.
    fn attributes(&self, file: &mut Ogawa, scene: &Scene, width: &[u8]) -> Result<Vec<Property>> {
        let uvs = self.curves.iter().flat_map(|&curve| scene.root_uvs[curve].to_array());
        let numbers = self.curves.iter().map(|&curve| scene.curves.strands[curve] as i32);
        let mut attributes = vec![
            Property { name: "groom_width", metadata: FLOAT_CONSTANT, body: Samples::of(file, FLOAT, width)? },
            Property { name: "groom_group_id", metadata: INT_CONSTANT, body: Samples::of(file, INT, &ints([0]))? },
            Property {
                name: "groom_guide",
                metadata: INT_CONSTANT,
                body: Samples::of(file, INT, &ints([i32::from(self.is_guide)]))?,
            },
            Property {
                name: "groom_id",
                metadata: INT_UNIFORM,
                body: Samples::of(file, INTS, &ints(self.ids.iter().copied()))?,
            },
            Property { name: "strand", metadata: INT_UNIFORM, body: Samples::of(file, INTS, &ints(numbers))? },
            Property {
                name: "groom_root_uv",
                metadata: "geoScope=uni;interpretation=vector;isGeomParam=true;podName=float32_t;podExtent=2",
                body: Samples::of(file, (Pod::Float32, 2, Shape::Many), &floats(uvs))?,
            },
        ];
        if let Some(closest) = &self.closest {
            let thrice = closest.iter().flat_map(|&guide| [guide; 3]);
            let weights = closest.iter().flat_map(|_| [1.0, 0.0, 0.0]);
            attributes.push(Property {
                name: "groom_closest_guides",
                metadata: "geoScope=uni;interpretation=vector;isGeomParam=true;podName=int32_t;podExtent=3",
                body: Samples::of(file, (Pod::Int32, 3, Shape::Many), &ints(thrice))?,
            });
            attributes.push(Property {
                name: "groom_guide_weights",
                metadata: "geoScope=uni;interpretation=vector;isGeomParam=true;podName=float32_t;podExtent=3",
                body: Samples::of(file, (Pod::Float32, 3, Shape::Many), &floats(weights))?,
            });
        }
        Ok(attributes)
    }
}

const INT: (Pod, u32, Shape) = (Pod::Int32, 1, Shape::One);
const INTS: (Pod, u32, Shape) = (Pod::Int32, 1, Shape::Many);
const FLOAT: (Pod, u32, Shape) = (Pod::Float32, 1, Shape::One);
const INT_CONSTANT: &str = "geoScope=con;isGeomParam=true;podName=int32_t;podExtent=1";
const INT_UNIFORM: &str = "geoScope=uni;isGeomParam=true;podName=int32_t;podExtent=1";
const INT_VERTEX: &str = "geoScope=vtx;isGeomParam=true;podName=int32_t;podExtent=1";
const FLOAT_CONSTANT: &str = "geoScope=con;isGeomParam=true;podName=float32_t;podExtent=1";
const FLOAT_VERTEX: &str = "geoScope=vtx;isGeomParam=true;podName=float32_t;podExtent=1";

fn ints(numbers: impl IntoIterator<Item = i32>) -> Vec<u8> {
    numbers.into_iter().flat_map(i32::to_le_bytes).collect()
}

fn floats(numbers: impl IntoIterator<Item = f32>) -> Vec<u8> {
    numbers.into_iter().flat_map(f32::to_le_bytes).collect()
}
