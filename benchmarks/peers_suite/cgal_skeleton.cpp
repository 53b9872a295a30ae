// CGAL's mean curvature flow skeleton: OFF on standard input; seconds, counts, nodes, edges out.
#include <CGAL/Mean_curvature_flow_skeletonization.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>

#include <cstdlib>
#include <ctime>
#include <iostream>

typedef CGAL::Simple_cartesian<double> Kernel;
typedef CGAL::Surface_mesh<Kernel::Point_3> Mesh;
typedef CGAL::Mean_curvature_flow_skeletonization<Mesh> Flow;

int main(int count, char** words) {
  Mesh mesh;
  if (!(std::cin >> mesh)) return 1;
  const std::clock_t start = std::clock();
  Flow flow(mesh);
  if (count > 1) flow.set_quality_speed_tradeoff(std::atof(words[1]));
  Flow::Skeleton skeleton;
  flow(skeleton);
  const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
  std::cout.precision(17);
  std::cout << seconds << "\n" << num_vertices(skeleton) << " " << num_edges(skeleton) << "\n";
  for (auto node : CGAL::make_range(vertices(skeleton))) std::cout << skeleton[node].point << "\n";
  for (auto edge : CGAL::make_range(edges(skeleton)))
    std::cout << source(edge, skeleton) << " " << target(edge, skeleton) << "\n";
  return 0;
}
