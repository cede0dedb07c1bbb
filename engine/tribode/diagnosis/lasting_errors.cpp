#include "tribode/diagnosis/lasting_errors.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {
namespace {

// A motion of variance one in D states, of which the first is seen [Rasmussen 2006, (4.14)].
template <int D>
struct Motion {
    Eigen::Matrix<double, D, D> step, covariance; // over one sample; of the states

    explicit Motion(double lasts) {
        const double rate = 1 / lasts, forgotten = std::exp(-rate);
        if constexpr (D == 1) {
            step << forgotten;
            covariance << 1;
        } else {
            step << forgotten * (1 + rate), forgotten, -forgotten * rate * rate, forgotten * (1 - rate);
            covariance << 1, 0, 0, rate * rate;
        }
    }
};

// Columns of signals, a sample each: what of them does not follow from the samples before, over its deviation, if they are white
// noise of variance one and the motion with `ratio` times its variance. Returns the logarithm of the determinant of V.
template <int D>
double whiten(const Eigen::MatrixXd& signals, const std::vector<std::size_t>& rows, const Motion<D>& motion,
              double ratio, Eigen::MatrixXd& whitened) {
    using States = Eigen::Matrix<double, D, D>;
    const States begin = ratio * motion.covariance;
    const States noise = begin - motion.step * begin * motion.step.transpose();
    double log_determinant = 0;
    Eigen::Index k = 0;
    for (const std::size_t count : rows) {
        States covariance = begin;
        Eigen::Matrix<double, Eigen::Dynamic, D> states =
            Eigen::Matrix<double, Eigen::Dynamic, D>::Zero(signals.rows(), D);
        for (const Eigen::Index end = k + static_cast<Eigen::Index>(count); k < end; ++k) {
            const double variance = covariance(0, 0) + 1;
            const Eigen::Matrix<double, D, 1> gain = motion.step * covariance.col(0) / variance;
            auto innovation = whitened.col(k);
            innovation = signals.col(k) - states.col(0);
            states = states * motion.step.transpose() + innovation * gain.transpose();
            covariance =
                (motion.step * covariance * motion.step.transpose() + noise - variance * gain * gain.transpose())
                    .eval();
            innovation /= std::sqrt(variance);
            log_determinant += std::log(variance);
        }
    }
    return log_determinant;
}

// Q K Q^T of the correlation K of the motion, and of rows Q that are orthonormal.
template <int D>
Eigen::MatrixXd correlated(const Eigen::MatrixXd& rows_of_signals, const std::vector<std::size_t>& rows, double lasts) {
    const double rate = 1 / lasts, forgotten = std::exp(-rate);
    const Eigen::Index n = rows_of_signals.rows();
    Eigen::MatrixXd before(n, rows_of_signals.cols()); // the sum of all samples before by their correlation
    Eigen::Index k = 0;
    for (const std::size_t count : rows) {
        Eigen::VectorXd sum = Eigen::VectorXd::Zero(n), growing = Eigen::VectorXd::Zero(n);
        for (const Eigen::Index end = k + static_cast<Eigen::Index>(count); k < end; ++k) {
            before.col(k) = sum;
            if constexpr (D == 2) before.col(k) += rate * growing;
            sum += rows_of_signals.col(k);
            growing += sum;
            growing *= forgotten;
            sum *= forgotten;
        }
    }
    const Eigen::MatrixXd products = rows_of_signals * before.transpose();
    return Eigen::MatrixXd::Identity(n, n) + products + products.transpose();
}

// The mean of the variances of hypotheses, weighed by their likelihood.
class WeighedMean {
  public:
    explicit WeighedMean(Eigen::Index size) : sum_(Eigen::MatrixXd::Zero(size, size)) {}

    void add(double log_likelihood, const Eigen::MatrixXd& normal) {
        if (!std::isfinite(log_likelihood)) return;
        if (log_likelihood > largest_) {
            const double kept = std::exp(largest_ - log_likelihood);
            sum_ *= kept;
            weights_ *= kept;
            largest_ = log_likelihood;
        }
        const double weight = std::exp(log_likelihood - largest_);
        sum_ += weight * normal;
        weights_ += weight;
    }
    Eigen::MatrixXd mean() const { return sum_ / weights_; }

  private:
    Eigen::MatrixXd sum_;
    double weights_ = 0, largest_ = -std::numeric_limits<double>::infinity();
};

} // namespace

Eigen::MatrixXd normal_of_lasting_errors(const Eigen::VectorXd& errors, const Eigen::MatrixXd& slopes,
                                         const std::vector<std::size_t>& rows) {
    if (errors.size() == 0) return Eigen::MatrixXd::Zero(slopes.cols(), slopes.cols());
    // Orthonormal columns in place of the slopes.
    const Eigen::RowVectorXd norm = slopes.colwise().norm();
    const Eigen::RowVectorXd back = norm.unaryExpr([](double n) { return n > 0 ? 1 / n : 0; });
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> split(slopes * back.asDiagonal());
    split.setThreshold(1e-10);
    const Eigen::Index p = split.rank(), n = slopes.rows();
    Eigen::MatrixXd signals(p + 1, n);
    signals.topRows(p) = (split.householderQ() * Eigen::MatrixXd::Identity(n, p)).transpose();
    signals.row(p) = errors.transpose();
    const Eigen::MatrixXd own = signals.topRows(p), combined = own * slopes;
    const double squares = errors.squaredNorm(), free = static_cast<double>(std::max<Eigen::Index>(1, n - p));
    const auto normal_of = [&](const Eigen::MatrixXd& of_own) { return combined.transpose() * of_own * combined; };
    const Eigen::MatrixXd white = squares / free * Eigen::MatrixXd::Identity(p, p);
    if (!(squares > 0) || n < 2 * p + 10) return normal_of(white); // too few to tell how they follow each other

    WeighedMean mean(p);
    mean.add(-free / 2 * std::log(squares / free), white);
    Eigen::MatrixXd whitened(p + 1, n);
    const auto add = [&](const auto& motion, const Eigen::MatrixXd& of_motion, double ratio) {
        const double log_determinant = whiten(signals, rows, motion, ratio, whitened);
        const Eigen::MatrixXd products = whitened * whitened.transpose();
        const Eigen::LLT<Eigen::MatrixXd> followed(products.topLeftCorner(p, p));
        const Eigen::VectorXd with = products.col(p).head(p);
        const double variance = (products(p, p) - with.dot(followed.solve(with))) / free;
        const double log_of_followed = 2 * followed.matrixLLT().diagonal().array().log().sum();
        mean.add(-(free * std::log(variance) + log_determinant + log_of_followed) / 2,
                 variance * (Eigen::MatrixXd::Identity(p, p) + ratio * of_motion));
    };
    // Sizes by the density of slow motion over that of the noise: what lasts too long to be seen then is at most as large as
    // what would just be seen. What lasts longer than a third of a record is a part of its mean and its slope.
    const auto longest = static_cast<double>(*std::ranges::max_element(rows));
    for (double lasts = 2; lasts < longest / 3; lasts *= 4) {
        const Eigen::MatrixXd rough = correlated<1>(own, rows, lasts), smooth = correlated<2>(own, rows, lasts);
        for (double density = 1; density < 1e7; density *= 10) {
            add(Motion<1>(lasts), rough, density / (2 * lasts));
            add(Motion<2>(lasts), smooth, density / (4 * lasts));
        }
    }
    return normal_of(mean.mean());
}

} // namespace tribode
