"""Several skins of a file, each a node.

    ros2 launch skin_msgs skins.launch.py skins:=/path/skins.toml namespace:=robot1

`rclpy:=true` publishes by skin_node.py in place of the program itself; then there is no service ~/tare.
`program:=PATH` names the program where it is not on the PATH.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    of = LaunchConfiguration
    return LaunchDescription(
        [
            DeclareLaunchArgument("skins", description="the file of the skins (docs/skins.md)"),
            DeclareLaunchArgument("namespace", default_value="/", description="in front of the names of all skins"),
            DeclareLaunchArgument("program", default_value="skin", description="the program"),
            DeclareLaunchArgument("rclpy", default_value="false", description="publish by skin_node.py"),
            ExecuteProcess(
                cmd=[of("program"), "run", "--skins", of("skins"), "--no-open", "--ros2", of("namespace")],
                output="screen",
                condition=UnlessCondition(of("rclpy")),
            ),
            Node(
                package="skin_msgs",
                executable="skin_node.py",
                namespace=of("namespace"),
                parameters=[{"skin": of("program"), "arguments": ["--skins", of("skins")]}],
                output="screen",
                condition=IfCondition(of("rclpy")),
            ),
        ]
    )
