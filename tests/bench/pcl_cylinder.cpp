// PCL's SACSegmentationFromNormals as the diameter paper sets it, behind a pipe: one request a line on standard input
//   <file of float32 x y z triples> <number of points>
// one JSON line back for each: milliseconds of the normals, and for each normal weight (the arguments) and d_max those of the
// search with what it found. The paper has no normal weight (0); 0.1 is PCL's default.
// Early stopping is switched off by a probability of 1: RandomSampleConsensus stops after log(1 - p) / log(...) draws, which
// is then infinite, so that all iterations run; `iterations` in the answer is the library's own count.

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include <pcl/console/print.h>
#include <pcl/features/normal_3d.h>
#include <pcl/pcl_config.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/sac_model_cylinder.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/sac_segmentation.h>

namespace {

using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Cylinder = pcl::SampleConsensusModelCylinder<Point, pcl::Normal>;

constexpr int kNeighbours = 50;
constexpr int kIterations = 10000;
constexpr double kRadiusMin = 0.05, kRadiusMax = 0.6;
constexpr double kDMax[] = {0.010, 0.090};

// The count of iterations is protected; a member pointer made in a derived class may read it.
struct Count : pcl::SampleConsensus<Point> {
  static int of(const pcl::SampleConsensus<Point>& method) { return method.*(&Count::iterations_); }
};

class Stopwatch {
 public:
  double milliseconds() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

Cloud::Ptr read_cloud(const std::string& path, std::size_t count) {
  std::vector<float> numbers(3 * count);
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(float)));
  if (!file) return nullptr;
  auto cloud = std::make_shared<Cloud>();
  cloud->reserve(count);
  for (std::size_t i = 0; i < count; ++i) cloud->emplace_back(numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]);
  return cloud;
}

Normals::Ptr estimate_normals(const Cloud::Ptr& cloud) {
  auto normals = std::make_shared<Normals>();
  pcl::NormalEstimation<Point, pcl::Normal> estimation;
  estimation.setInputCloud(cloud);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<Point>>());
  estimation.setKSearch(kNeighbours);
  estimation.compute(*normals);
  return normals;
}

// PCL's own refinement over the inliers, not counted in the time of the search.
double refined_radius(const Cloud::Ptr& cloud, const Normals::Ptr& normals, const pcl::PointIndices& inliers,
                      const pcl::ModelCoefficients& found, double weight) {
  Cylinder model(cloud);
  model.setInputNormals(normals);
  model.setNormalDistanceWeight(weight);
  Eigen::VectorXf before = Eigen::Map<const Eigen::VectorXf>(found.values.data(), 7), after;
  model.optimizeModelCoefficients(inliers.indices, before, after);
  return std::abs(after[6]);
}

std::string search(const Cloud::Ptr& cloud, const Normals::Ptr& normals, double d_max, double weight) {
  pcl::SACSegmentationFromNormals<Point, pcl::Normal> segmentation;
  segmentation.setModelType(pcl::SACMODEL_CYLINDER);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setOptimizeCoefficients(false);
  segmentation.setNormalDistanceWeight(weight);
  segmentation.setMaxIterations(kIterations);
  segmentation.setProbability(1.0);
  segmentation.setDistanceThreshold(d_max);
  segmentation.setRadiusLimits(kRadiusMin, kRadiusMax);
  segmentation.setInputCloud(cloud);
  segmentation.setInputNormals(normals);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients found;
  const Stopwatch watch;
  segmentation.segment(inliers, found);
  const double ms = watch.milliseconds();

  std::ostringstream out;
  out << "{\"d_max\":" << d_max << ",\"normal_weight\":" << weight << ",\"search_ms\":" << ms << ",\"iterations\":" << Count::of(*segmentation.getMethod());
  if (found.values.size() == 7 && inliers.indices.size() > 7) {
    out << ",\"inliers\":" << inliers.indices.size() << ",\"radius\":" << found.values[6];
    const double refined = refined_radius(cloud, normals, inliers, found, weight);
    if (std::isfinite(refined)) out << ",\"refined_radius\":" << refined;
  }
  out << "}";
  return out.str();
}

}  // namespace

int main(int argc, char** argv) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  std::vector<double> weights;
  for (int i = 1; i < argc; ++i) weights.push_back(std::stod(argv[i]));
  std::cout << "{\"pcl\":\"" << PCL_VERSION_PRETTY << "\"}" << std::endl;
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream request(line);
    std::string path;
    std::size_t count = 0;
    request >> path >> count;
    const Cloud::Ptr cloud = read_cloud(path, count);
    if (!cloud) {
      std::cout << "{\"error\":\"cannot read " << count << " points\"}" << std::endl;
      continue;
    }
    const Stopwatch watch;
    const Normals::Ptr normals = estimate_normals(cloud);
    const double normals_ms = watch.milliseconds();
    std::ostringstream answer;
    answer << "{\"normals_ms\":" << normals_ms << ",\"searches\":[";
    const char* comma = "";
    for (const double weight : weights) {
      for (const double d_max : kDMax) {
        answer << comma << search(cloud, normals, d_max, weight);
        comma = ",";
      }
    }
    std::cout << answer.str() << "]}" << std::endl;
  }
}
