//! Names of Mitsuba 0.5 and 0.6 as Mitsuba 3 writes them.

/// `toWorld` as `to_world`, `intIOR` as `int_ior`.
pub(super) fn modern(name: &str) -> String {
    match name {
        "lookAt" => return "lookat".to_owned(),
        // Spelled so by both.
        _ if !name.contains(char::is_uppercase) => return name.to_owned(),
        _ => {}
    }
    let mut text = String::with_capacity(name.len() + 4);
    let mut before = '_';
    for c in name.chars() {
        if c.is_uppercase() && (before.is_lowercase() || before.is_numeric()) {
            text.push('_');
        }
        text.extend(c.to_lowercase());
        before = c;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::modern;

    #[test]
    fn old_names_become_new_ones() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("lookAt", "lookat"),
            ("alphaU", "alpha_u"),
            ("diffuseReflectance", "diffuse_reflectance"),
            ("filename", "filename"),
            ("color0", "color0"),
        ] {
            assert_eq!(modern(old), new);
        }
    }
}
