//! Numbers and matrices in JSON of any layout.

use serde_json::Value;

/// Lists nested deeper than this are no matrix.
const MAX_DEPTH: usize = 4;

/// All numbers of a number, of a list (of lists) of numbers in reading order, or of an `opencv-matrix`.
pub(super) fn numbers(value: &Value) -> Option<Vec<f64>> {
    if let Some(data) = value.get("data") {
        return numbers(data);
    }
    let mut all = Vec::new();
    gather(value, 0, &mut all).then_some(all)
}

fn gather(value: &Value, depth: usize, all: &mut Vec<f64>) -> bool {
    match value {
        Value::Array(items) => depth < MAX_DEPTH && items.iter().all(|item| gather(item, depth + 1, all)),
        other => other.as_f64().map(|number| all.push(number)).is_some(),
    }
}

/// Whether a matrix as OpenCV's file storage writes it is at the top, or one or two levels below.
pub(super) fn holds_opencv_matrix(value: &Value) -> bool {
    fn below(value: &Value, depth: usize) -> bool {
        let is_one = value.get("type_id").and_then(Value::as_str).is_some_and(|id| id.starts_with("opencv"));
        let mut children: Box<dyn Iterator<Item = &Value>> = match value {
            Value::Object(map) => Box::new(map.values()),
            Value::Array(items) => Box::new(items.iter()),
            _ => return false,
        };
        is_one || depth < 3 && children.any(|child| below(child, depth + 1))
    }
    below(value, 0)
}

/// A number by its key.
pub(super) fn number(value: &Value, key: &str) -> Option<f64> {
    value.get(key).and_then(Value::as_f64)
}
