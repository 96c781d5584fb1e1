//! The part of XML that OpenCV's file storage writes: elements, `type_id="opencv-matrix"`, numbers as text.

use super::{
    opencv::{Node, matrix_from_map, number},
    xml_tree::{Element, Fault},
};

/// The entries of `<opencv_storage>`; an error is a line (from 1) and a fact.
pub(super) fn nodes(document: &Element) -> Result<Node, Fault> {
    let root = document.find("opencv_storage").ok_or((1, "is not an OpenCV file (no <opencv_storage>)".to_owned()))?;
    Ok(Node::Map(map_of(root)?))
}

fn map_of(element: &Element) -> Result<Vec<(String, Node)>, Fault> {
    element.children.iter().map(|child| Ok((child.name.clone(), node(child)?))).collect()
}

fn node(element: &Element) -> Result<Node, Fault> {
    let is_matrix = element.attribute("type_id").is_some_and(|id| id == "opencv-matrix" || id == "opencv-nd-matrix");
    if is_matrix {
        return matrix_from_map(map_of(element)?).map_err(|fact| (element.line, fact));
    }
    if !element.children.is_empty() {
        return Ok(Node::Map(map_of(element)?));
    }
    let numbers: Option<Vec<f64>> = element.text.split_whitespace().map(number).collect();
    Ok(match numbers {
        Some(numbers) if !numbers.is_empty() => Node::Numbers(numbers),
        _ => Node::Text(element.text.trim().trim_matches('"').to_owned()),
    })
}
