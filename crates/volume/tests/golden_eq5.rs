//! Equation 5 against vectors from an independent reference.

use glam::{DVec3, DVec4};
use serde_json::Value;
use strandflow_core::{Grid, Occupancy};
use strandflow_volume::velocity::{Border, Region, normalised};

type Cells<T> = Vec<Vec<Vec<T>>>;

#[test]
fn eq5_printed_and_normalised_with_both_borders() {
    let path = format!("{}/tests/golden/eq5.json", env!("CARGO_MANIFEST_DIR"));
    let golden: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let given: Cells<[f64; 3]> = serde_json::from_value(golden["v"].clone()).unwrap();
    let occupied: Cells<f64> = serde_json::from_value(golden["occ"].clone()).unwrap();
    let inside: Cells<f64> = serde_json::from_value(golden["region"].clone()).unwrap();

    // The vectors are indexed [x][y][z]; the grid runs x fastest.
    let dims = [given.len(), given[0].len(), given[0][0].len()];
    let grid = Grid { origin: DVec3::ZERO, voxel_mm: 1.0, dims };
    let mut occupancy = Occupancy::empty(grid);
    for index in 0..grid.len() {
        let [x, y, z] = grid.coordinates(index);
        occupancy.set(index, inside[x][y][z] != 0.0);
    }
    let region = Region::new(&occupancy);
    let voxels: Vec<[usize; 3]> = region.indices.iter().map(|&i| grid.coordinates(i as usize)).collect();
    let start: Vec<DVec4> =
        voxels.iter().map(|&[x, y, z]| DVec3::from_array(given[x][y][z]).extend(occupied[x][y][z])).collect();
    let largest = start.iter().map(|v| v.truncate().abs().max_element()).fold(0.0, f64::max);

    for case in golden["cases"].as_array().unwrap() {
        let border = if case["border"] == "zero" { Border::Zero } else { Border::Neumann };
        let (s, sweeps) = (case["s"].as_f64().unwrap(), case["iters"].as_u64().unwrap() as usize);
        let expected: Cells<[f64; 3]> = serde_json::from_value(case["v"].clone()).unwrap();
        let expected_normalised: Cells<[f64; 3]> = serde_json::from_value(case["v_normalised"].clone()).unwrap();
        let plain = region.diffuse(start.clone(), s, sweeps, border);
        let divided = normalised(&region, start.clone(), (s, sweeps, border), 1e-12, |v| v.w);
        for (i, &[x, y, z]) in voxels.iter().enumerate() {
            let off = plain[i].truncate().distance(DVec3::from_array(expected[x][y][z]));
            assert!(off < 1e-12 * largest, "{s} {sweeps} {border:?}: {off:e}");
            let found = divided[i].map_or(DVec3::ZERO, |v| v.truncate());
            let off = found.distance(DVec3::from_array(expected_normalised[x][y][z]));
            assert!(off < 1e-12 * largest, "normalised {s} {sweeps} {border:?}: {off:e}");
        }
    }
}
