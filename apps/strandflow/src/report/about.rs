//! What the take is made of, and the settings that differ from the defaults.

use serde_json::Value;
use strandflow_engine::Settings;
use strandflow_report::{Html, html::Cell};

use super::opened::Opened;

/// Sources, versions and settings.
pub fn section(take: &Opened) -> Html {
    let manifest = take.manifest();
    let row = |name: &str, value: String| vec![Cell::Text(name.into()), Cell::Text(value)];
    let mut rows = vec![
        row("Calibration", manifest.calibration.file.clone()),
        row("Frames a second", manifest.fps.to_string()),
        row("Gravity", format!("{:?} mm/s²", manifest.gravity)),
        row("Frames of the manifest", manifest.frames.clone().unwrap_or("all".into())),
        row("Marker labels", manifest.labels.markers.clone()),
        row("Hair masks", manifest.labels.hair_masks.clone()),
    ];
    if let Some(plan) = take.last_run() {
        rows.push(row("Last run", format!("frames {}, version {}, seed {}", plan.frames, plan.version, plan.seed)));
        rows.push(row("Mode", format!("{:?}", plan.mode).to_lowercase()));
    }
    let mut html = Html::table(&["What", ""], rows);
    let view = |(i, view): (usize, &strandflow_engine::manifest::View)| {
        let camera = take.rig().and_then(|rig| rig.cameras.get(i));
        let size = camera.map_or("–".into(), |camera| format!("{}×{}", camera.width, camera.height));
        let part = if manifest.held_out.contains(&view.name) { "held out" } else { "takes part" };
        vec![
            Cell::Text(view.name.clone()),
            Cell::Number(size),
            Cell::Text(part.into()),
            Cell::Text(view.source.clone()),
        ]
    };
    html.push(Html::heading("Views"));
    html.push(Html::table(&["View", "Pixels", "", "Source"], manifest.views.iter().enumerate().map(view)));
    html.push(Html::heading("Settings that differ from the defaults"));
    let used = take.last_run().map_or(&manifest.settings, |plan| &plan.settings);
    html.push(settings(used));
    if take.last_run().is_some_and(|plan| plan.settings != manifest.settings) {
        html.push(Html::warning(
            "The settings in force now, of the manifest and by default, are not those of the last run, which are shown.",
            &format!("`strandflow run {}` takes up the new ones.", take.name()),
        ));
    }
    html
}

fn settings(used: &Settings) -> Html {
    let (Ok(used), Ok(defaults)) = (serde_json::to_value(used), serde_json::to_value(Settings::default())) else {
        return Html::default();
    };
    let mut rows = Vec::new();
    differing("", &used, &defaults, &mut rows);
    if rows.is_empty() {
        return Html::paragraph("None.");
    }
    let row = |(name, used, default): (String, String, String)| {
        vec![Cell::Text(name), Cell::Number(used), Cell::Number(default)]
    };
    Html::table(&["Setting", "Used", "Default"], rows.into_iter().map(row))
}

/// Adds (name, used, default) of every leaf that differs.
fn differing(name: &str, used: &Value, default: &Value, found: &mut Vec<(String, String, String)>) {
    match (used, default) {
        (Value::Object(used), Value::Object(defaults)) => {
            for (key, value) in used {
                let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                differing(&name, value, defaults.get(key).unwrap_or(&Value::Null), found);
            }
        }
        _ if used != default => found.push((name.to_owned(), used.to_string(), default.to_string())),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_differs_is_told() {
        assert!(settings(&Settings::default()).into_text().contains("None."));
        let mut used = Settings::default();
        used.hull.voxel_mm = 3.5;
        let text = settings(&used).into_text();
        assert!(text.contains("hull.voxel_mm") && text.contains("3.5") && text.matches("<tr>").count() == 2, "{text}");
    }
}
