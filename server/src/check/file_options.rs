//! Options of an exported file.

use super::question::about;
use super::refusal::Refusal;
use crate::export::{FileOptions, FileUp};

/// Checks the text, whose relevancy a mesh shows, and the axis that points up. The voxel size is checked
/// where the mesh is made. An empty `up` is none.
///
/// # Errors
/// [`Refusal`] names `text` or `up`.
pub(crate) fn file_options(
    voxel_metres: Option<f32>,
    text: Option<&str>,
    up: Option<&str>,
) -> Result<FileOptions, Refusal> {
    let axis = |name: &str| {
        let expected = "expected x, y, z, -x, -y, -z or map";
        let found = || name.chars().take(40).collect::<String>();
        FileUp::named(name)
            .ok_or_else(|| Refusal::new("up", format!("{expected}, found {:?}", found())))
    };
    let up = up.filter(|name| !name.is_empty()).map(axis).transpose()?;
    Ok(FileOptions { voxel_metres, question: text.map(about).transpose()?, up })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_names() {
        let up = |name| file_options(None, None, name).map(|options| options.up);
        assert_eq!((up(None).unwrap(), up(Some("")).unwrap()), (None, None));
        assert_eq!(up(Some("map")).unwrap(), Some(FileUp::Map));
        for name in ["x", "y", "z", "-x", "-y", "-z"] {
            assert!(matches!(up(Some(name)).unwrap(), Some(FileUp::Axis(_))), "{name}");
        }
        for name in ["Y", "+y", "up", "-", "--y"] {
            let refusal = up(Some(name)).unwrap_err();
            assert!(refusal.field == "up" && refusal.reason.contains(name), "{refusal}");
        }
    }
}
