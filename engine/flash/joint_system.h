#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "engine/flash/joint.h"

namespace patina {

/// The normal equations of a sample at a state: texels eliminated, shared unknowns left. For this room.
class JointSystem {
 public:
  JointSystem(const JointState& state, const FlashSample& sample, const std::vector<FlashUnknown>& unknowns,
              std::span<const char> photos);
  double cost() const { return cost_; }
  /// Hessian of the shared unknowns, texels projected out, priors included.
  const Eigen::MatrixXd& shared() const { return shared_; }
  /// Its gradient, block by block of the sample (unknowns x blocks), without the shared priors.
  const Eigen::MatrixXd& blockGradients() const { return blockGradients_; }
  std::vector<TexelMatrix> information() const;
  /// The step of the shared unknowns, damped by Marquardt's rule.
  Eigen::VectorXd step(double damping) const;
  /// Adds the texels' own steps that go with it.
  void moveTexels(const Eigen::VectorXd& step, double damping, std::vector<TexelVector>& x) const;
  /// How texels answer to a change of the shared unknowns; [site].
  std::vector<TexelVector> answers(const Eigen::VectorXd& change) const;
  /// The cost of another state, with the weights of this one.
  double costOf(const JointState& other) const;

 private:
  struct Site {
    TexelMatrix own;
    TexelVector gradient;
    Eigen::Matrix<double, FlashTexel::kParameters, Eigen::Dynamic> mixed;
    std::vector<double> sd;  ///< of each observation and channel
    double cost = 0;
  };
  void assemble(std::size_t index, const std::vector<FlashModel>& moved, Eigen::MatrixXd& shared,
                Eigen::VectorXd& gradient);
  double priorCost(const FlashModel& model) const;

  const JointState& state_;
  const FlashSample& sample_;
  const std::vector<FlashUnknown>& unknowns_;
  std::span<const char> photos_;
  std::vector<TexelPrior> priors_;
  std::vector<Site> sites_;
  Eigen::MatrixXd shared_, blockGradients_;
  Eigen::VectorXd gradient_;
  double cost_ = 0;
};

}  // namespace patina
