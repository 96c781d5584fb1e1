//! All strands of a frame from the simulated guides.
//!
//! A strand's edges are its edges at rest, turned as the nearest guides' edges turned, laid end to end from the root.
//! So lengths are constant exactly, and waves turn with the strand that carries them.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::body::Skin;
use crate::groom::Groom;
use crate::spec::{Style, SynthSpec};

/// How the strands follow the guides.
#[derive(Clone, Debug)]
pub(crate) struct Follow {
    /// Per strand: (guide, weight), weights of sum 1; a guide follows itself.
    guides: Vec<Vec<(usize, f64)>>,
    /// Smoothed edge directions of the guides at rest.
    rest: Vec<Vec<DVec3>>,
    /// Edges to either side over which a guide's direction is taken, so that its own waves do not count.
    reach: usize,
}

impl Follow {
    /// Binds every strand to the nearest guides that are combed the same way.
    pub(crate) fn new(spec: &SynthSpec, groom: &Groom) -> Self {
        let count = spec.groom.guides.min(groom.strands.len());
        let reach = match spec.groom.style {
            Style::Straight => 1,
            _ => ((spec.groom.wave_length_mm / spec.groom.edge_mm * 0.5).round() as usize).max(1),
        };
        let heading = |s: &[DVec3]| (s[s.len() / 2] - s[0]).normalize_or(DVec3::NEG_Z);
        let headings: Vec<DVec3> = groom.strands[..count].iter().map(|s| heading(s)).collect();
        let guides = (0..groom.strands.len())
            .into_par_iter()
            .map(|i| {
                if i < count {
                    return vec![(i, 1.0)];
                }
                let strand = &groom.strands[i];
                let mut near: Vec<(f64, usize)> = (0..count)
                    .map(|g| {
                        let apart = groom.strands[g][0].distance(strand[0]);
                        let turned = headings[g].distance(heading(strand));
                        (apart * (1.0 + 3.0 * turned) + 1e-3, g)
                    })
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                near.truncate(4);
                let total: f64 = near.iter().map(|(d, _)| d.powi(-2)).sum();
                near.iter().map(|&(d, g)| (g, d.powi(-2) / total)).collect()
            })
            .collect();
        let rest = groom.strands[..count].iter().map(|s| directions(s, reach)).collect();
        Self { guides, rest, reach }
    }

    /// The strands (head frame) where the guides are at `now`.
    pub(crate) fn strands(&self, groom: &Groom, now: &[Vec<DVec3>], skin: &Skin) -> Vec<Vec<DVec3>> {
        let turns: Vec<Vec<DQuat>> = (0..now.len())
            .into_par_iter()
            .map(|g| {
                let current = directions(&now[g], self.reach);
                self.rest[g].iter().zip(&current).map(|(&a, &b)| DQuat::from_rotation_arc(a, b)).collect()
            })
            .collect();
        (0..groom.strands.len())
            .into_par_iter()
            .map(|i| {
                let rest = &groom.strands[i];
                lay(rest, skin, |k| match self.guides[i][..] {
                    [(g, _)] => now[g][k + 1] - now[g][k],
                    ref bound => {
                        let edge = rest[k + 1] - rest[k];
                        bound.iter().map(|&(g, w)| turns[g][k.min(turns[g].len() - 1)] * edge * w).sum()
                    }
                })
            })
            .collect()
    }
}

/// Lays edges end to end from the root, each of the length it has at rest, outside of head and body.
fn lay(rest: &[DVec3], skin: &Skin, edge: impl Fn(usize) -> DVec3) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(rest.len());
    out.push(rest[0]);
    let mut p = rest[0];
    for k in 0..rest.len() - 1 {
        let length = rest[k].distance(rest[k + 1]);
        let mut direction = edge(k).normalize_or((rest[k + 1] - rest[k]).normalize_or(DVec3::NEG_Z));
        for _ in 0..5 {
            let q = p + direction * length;
            if skin.distance(q) >= 0.1 {
                break;
            }
            direction = (skin.push_out(q, 0.4) - p).normalize_or(direction);
        }
        p += direction * length;
        out.push(p);
    }
    out
}

/// Direction of each edge, over `reach` edges to either side.
fn directions(points: &[DVec3], reach: usize) -> Vec<DVec3> {
    let last = points.len() - 1;
    (0..last)
        .map(|k| {
            let (a, b) = ((k + 1).saturating_sub(reach), (k + reach).min(last));
            (points[b] - points[a]).normalize_or(DVec3::NEG_Z)
        })
        .collect()
}
