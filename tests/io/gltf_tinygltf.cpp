// SPDX-License-Identifier: MIT
// What another reader of the format makes of our files; left out where it is not installed.
#include <traceur/io/gltf.hpp>

#include <string>

#include <doctest/doctest.h>

#if __has_include(<tiny_gltf.h>)
#define TINYGLTF_IMPLEMENTATION
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_USE_CPP14
#include <tiny_gltf.h>

TEST_CASE("tinygltf reads a file without a word of complaint") {
  namespace body = traceur::body;
  body::Character c;
  body::Joint root, arm;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  arm.name = arm.body = "arm";
  arm.parent = 0;
  arm.offset = {0, 0.2, 0.5};
  c.skeleton.add(root);
  c.skeleton.add(arm);
  body::Shape sphere;
  sphere.size = {0.1, 0, 0};
  c.shapes = {sphere};
  traceur::motion::Clip clip;
  clip.skeleton = c.skeleton;
  clip.times = Eigen::Vector3d(0, 0.1, 0.3);
  clip.poses = c.skeleton.neutral_pose().replicate(1, 3);
  traceur::io::GltfScene scene;
  scene.title = "one";
  scene.actors.push_back({"figure", c, clip});
  scene.terrain = traceur::terrain::HeightGrid::flat();
  const std::string bytes = traceur::io::format_gltf(scene);

  tinygltf::Model model;
  tinygltf::TinyGLTF reader;
  std::string error, warning;
  REQUIRE(reader.LoadBinaryFromMemory(&model, &error, &warning, reinterpret_cast<const unsigned char*>(bytes.data()),
                                      static_cast<unsigned int>(bytes.size())));
  CHECK(error == "");
  CHECK(warning == "");
  CHECK(model.asset.version == "2.0");
  CHECK(model.nodes.size() == 4);
  CHECK(model.meshes.size() == 2);
  REQUIRE(model.animations.size() == 1);
  CHECK(model.animations[0].channels.size() == 3);
  const tinygltf::Accessor& times = model.accessors[static_cast<std::size_t>(model.animations[0].samplers[0].input)];
  CHECK(times.count == 3);
  CHECK(times.maxValues[0] == doctest::Approx(0.3));
}
#endif
