// PCL's NDT on given clouds, printed as JSON: the peer of the benchmark beside this file.
//
//   pcl_ndt labels CLOUD.pcd                 loads into PointXYZL; prints counts and sums
//   pcl_ndt place SOURCE.pcd TARGET.pcd RESOLUTION EPSILON REPEATS x y z yaw_rad
//           prints pose, iterations, TP, fitness score, seconds of building the grid and of aligning
//   pcl_ndt starts ndt|icp SOURCE.pcd TARGET.pcd RESOLUTION EPSILON STARTS.txt
//           places from every start (16 numbers a line, row by row); prints all poses and seconds
//           (for icp RESOLUTION is the largest distance of a correspondence)
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
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

using Points = pcl::PointCloud<pcl::PointXYZ>;

static int starts(pcl::Registration<pcl::PointXYZ, pcl::PointXYZ> &method, char **argv) {
  Points::Ptr source(new Points), target(new Points);
  if (pcl::io::loadPCDFile(argv[1], *source) < 0 || pcl::io::loadPCDFile(argv[2], *target) < 0) return 1;
  method.setTransformationEpsilon(std::stod(argv[4]));
  method.setMaximumIterations(100);
  method.setInputSource(source);
  method.setInputTarget(target);
  std::ifstream file(argv[5]);
  std::string poses, seconds;
  Eigen::Matrix4f start;
  for (;;) {
    for (int k = 0; k < 16; ++k) file >> start(k / 4, k % 4);
    if (!file) break;
    Points output;
    const auto begin = Clock::now();
    method.align(output, start);
    char text[400];
    std::snprintf(text, sizeof text, "%s%.6f", seconds.empty() ? "" : ", ", since(begin));
    seconds += text;
    const Eigen::Matrix4f T = method.getFinalTransformation();
    poses += poses.empty() ? "[" : ", [";
    for (int k = 0; k < 16; ++k) {
      std::snprintf(text, sizeof text, "%s%.9g", k ? ", " : "", T(k / 4, k % 4));
      poses += text;
    }
    poses += "]";
  }
  std::printf("{\"poses\": [%s], \"seconds\": [%s]}\n", poses.c_str(), seconds.c_str());
  return 0;
}

static int from_starts(char **argv) {
  if (!std::strcmp(argv[0], "ndt")) {
    pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ> ndt;
    ndt.setResolution(std::stof(argv[3]));
    ndt.setStepSize(0.1);
    return starts(ndt, argv);
  }
  pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ> icp;
  icp.setMaxCorrespondenceDistance(std::stod(argv[3]));
  return starts(icp, argv);
}

int main(int argc, char **argv) {
  if (argc == 3 && !std::strcmp(argv[1], "labels")) return labels(argv[2]);
  if (argc == 11 && !std::strcmp(argv[1], "place")) return place(argv + 2);
  if (argc == 8 && !std::strcmp(argv[1], "starts")) return from_starts(argv + 2);
  std::fprintf(stderr, "usage: pcl_ndt labels CLOUD | starts ndt|icp SOURCE TARGET RESOLUTION EPSILON STARTS | place SOURCE TARGET RESOLUTION EPSILON REPEATS x y z yaw\n");
  return 2;
}
