//! `skin run --ros2` as far as it needs no network; tests/ros2.sh does the rest.

use crate::program::{output, said};
use std::path::Path;

/// The definitions in a bag are those that a workspace of ROS 2 builds.
#[test]
fn bags_have_the_definitions_of_the_package() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let package = root.join("../contrib/ros2/skin_msgs");
    let list = std::fs::read_to_string(package.join("CMakeLists.txt")).unwrap();
    let mut files = 0;
    for entry in std::fs::read_dir(package.join("msg")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let of = |path: &Path| std::fs::read_to_string(path.join(&name)).unwrap();
        assert_eq!(of(&package.join("msg")), of(&root.join("src/export/ros")), "{name}");
        assert!(list.contains(&format!("msg/{name}")), "{name} is not in CMakeLists.txt");
        files += 1;
    }
    assert_eq!(files, 3);
}

#[test]
fn a_namespace_that_ros_does_not_take_is_refused() {
    let refused = output(&["run", "--simulate", "--json", "--frames", "1", "--ros2", "/robot-1"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(said(&refused).contains("--ros2"), "{}", said(&refused));
}
