// PCL's CVFHEstimation behind a pipe: one request a line on standard input
//   <file of float32 x y z triples> <number of points> <neighbours of a normal> <curvature> <tolerance> <angle> <points> <radius>
// one JSON line back for each: {"normals": seconds, "cvfh": seconds, "histograms": [[308 numbers], ...]}.

#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <pcl/features/cvfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/pcl_config.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

int main() {
  std::printf("{\"pcl\": \"%s\"}\n", PCL_VERSION_PRETTY);
  std::fflush(stdout);
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream words(line);
    std::string path;
    std::size_t count = 0, least = 0;
    int neighbours = 0;
    float curvature = 0, tolerance = 0, angle = 0, radius = 0;
    words >> path >> count >> neighbours >> curvature >> tolerance >> angle >> least >> radius;
    std::vector<float> numbers(3 * count);
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(float)));
    if (!file || !words) {
      std::printf("{\"error\": \"cannot read the request\"}\n");
      std::fflush(stdout);
      continue;
    }
    auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
    for (std::size_t i = 0; i < count; ++i) cloud->emplace_back(numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]);
    auto start = Clock::now();
    auto normals = std::make_shared<pcl::PointCloud<pcl::Normal>>();
    auto tree = std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>();
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimate;
    estimate.setInputCloud(cloud);
    estimate.setSearchMethod(tree);
    estimate.setKSearch(neighbours);
    estimate.compute(*normals);
    const double normal_seconds = since(start);
    start = Clock::now();
    pcl::CVFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::VFHSignature308> cvfh;
    cvfh.setInputCloud(cloud);
    cvfh.setInputNormals(normals);
    cvfh.setSearchMethod(tree);
    cvfh.setCurvatureThreshold(curvature);
    cvfh.setClusterTolerance(tolerance);
    cvfh.setEPSAngleThreshold(angle);
    cvfh.setMinPoints(least);
    cvfh.setRadiusNormals(radius);
    pcl::PointCloud<pcl::VFHSignature308> found;
    cvfh.compute(found);
    std::printf("{\"normals\": %.6f, \"cvfh\": %.6f, \"histograms\": [", normal_seconds, since(start));
    for (std::size_t i = 0; i < found.size(); ++i) {
      std::printf(i ? ",[" : "[");
      for (int k = 0; k < 308; ++k) std::printf(k ? ",%g" : "%g", found[i].histogram[k]);
      std::printf("]");
    }
    std::printf("]}\n");
    std::fflush(stdout);
  }
}
