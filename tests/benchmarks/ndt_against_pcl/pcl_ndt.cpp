// PCL's NDT on given clouds, printed as JSON: the peer of the benchmark beside this file.
//
//   pcl_ndt labels CLOUD.pcd                 loads into PointXYZL; prints counts and sums
//   pcl_ndt place SOURCE.pcd TARGET.pcd RESOLUTION EPSILON REPEATS x y z yaw_rad
//           prints pose, iterations, TP, fitness score, seconds of building the grid and of aligning
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>
#include <pcl/registration/ndt.h>

using Clock = std::chrono::steady_clock;

static double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

static int labels(const char *path) {
  pcl::PointCloud<pcl::PointXYZL> cloud;
  if (pcl::io::loadPCDFile(path, cloud) < 0) return 1;
  double x = 0, y = 0, z = 0, label = 0, mixed = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto &p = cloud[i];
    x += p.x, y += p.y, z += p.z, label += p.label;
    mixed += (i % 1009 + 1.0) * p.label + (i % 997) * double(p.x);  // order matters too
  }
  std::printf("{\"points\": %zu, \"sums\": [%.17g, %.17g, %.17g, %.17g, %.17g]}\n", cloud.size(), x, y, z, label, mixed);
  return 0;
}

static int place(char **argv) {
  using Cloud = pcl::PointCloud<pcl::PointXYZ>;
  Cloud::Ptr source(new Cloud), target(new Cloud);
  if (pcl::io::loadPCDFile(argv[0], *source) < 0 || pcl::io::loadPCDFile(argv[1], *target) < 0) return 1;
  const double resolution = std::stod(argv[2]), epsilon = std::stod(argv[3]);
  const int repeats = std::stoi(argv[4]);
  Eigen::Affine3f guess = Eigen::Translation3f(std::stof(argv[5]), std::stof(argv[6]), std::stof(argv[7])) *
                          Eigen::AngleAxisf(std::stof(argv[8]), Eigen::Vector3f::UnitZ());
  std::vector<double> grids, aligns;
  std::string result;
  for (int i = 0; i < repeats; ++i) {
    pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ> ndt;
    ndt.setResolution(resolution);
    ndt.setStepSize(0.1);
    ndt.setTransformationEpsilon(epsilon);
    ndt.setMaximumIterations(100);
    ndt.setInputSource(source);
    auto start = Clock::now();
    ndt.setInputTarget(target);
    grids.push_back(since(start));
    Cloud output;
    start = Clock::now();
    ndt.align(output, guess.matrix());
    aligns.push_back(since(start));
    if (i + 1 == repeats) {
      const Eigen::Matrix4f T = ndt.getFinalTransformation();
      std::printf("{\"T\": [");
      for (int r = 0; r < 4; ++r)
        std::printf("[%.9g, %.9g, %.9g, %.9g]%s", T(r, 0), T(r, 1), T(r, 2), T(r, 3), r < 3 ? ", " : "], ");
      std::printf("\"iterations\": %d, \"tp\": %.12g, \"fitness\": %.12g, ", ndt.getFinalNumIteration(),
                  ndt.getTransformationLikelihood(), ndt.getFitnessScore());
    }
  }
  std::printf("\"grid_s\": [");
  for (std::size_t i = 0; i < grids.size(); ++i) std::printf("%s%.6f", i ? ", " : "", grids[i]);
  std::printf("], \"align_s\": [");
  for (std::size_t i = 0; i < aligns.size(); ++i) std::printf("%s%.6f", i ? ", " : "", aligns[i]);
  std::printf("]}\n");
  return 0;
}

int main(int argc, char **argv) {
  if (argc == 3 && !std::strcmp(argv[1], "labels")) return labels(argv[2]);
  if (argc == 11 && !std::strcmp(argv[1], "place")) return place(argv + 2);
  std::fprintf(stderr, "usage: pcl_ndt labels CLOUD | place SOURCE TARGET RESOLUTION EPSILON REPEATS x y z yaw\n");
  return 2;
}
