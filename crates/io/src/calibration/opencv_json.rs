//! OpenCV file storage written as JSON: the same names as in YAML and XML (`opencv`).

use std::path::Path;

use serde_json::Value;

use super::{
    json_tree,
    opencv::{self, Node},
    settle::Described,
};
use crate::IoError;

/// Deeper nesting than this is no calibration.
const MAX_DEPTH: usize = 16;

/// What a JSON file of OpenCV says.
pub(super) fn described(path: &Path, value: &Value) -> Result<Described, IoError> {
    opencv::described_nodes(path, &node(value, 0))
}

fn node(value: &Value, depth: usize) -> Node {
    match value {
        Value::String(text) => Node::Text(text.clone()),
        _ if depth > MAX_DEPTH => Node::Text(String::new()),
        Value::Object(map) => match json_tree::numbers(value) {
            Some(matrix) => Node::Numbers(matrix),
            None => Node::Map(map.iter().map(|(key, value)| (key.clone(), node(value, depth + 1))).collect()),
        },
        _ => match json_tree::numbers(value) {
            Some(numbers) => Node::Numbers(numbers),
            None => Node::Map(
                value
                    .as_array()
                    .into_iter()
                    .flatten()
                    .enumerate()
                    .map(|(i, item)| (i.to_string(), node(item, depth + 1)))
                    .collect(),
            ),
        },
    }
}
